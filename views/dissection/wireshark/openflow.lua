-- What OpenFlow 1.4 messages say of light (wire/optical.py): our experimenter message for paths,
-- and the optical properties of ports with their units. Wireshark's own dissector has found the
-- messages, also those inside bundles; this adds branches to the packet.

local format = formats.openflow
local qof = Proto("qof", "OpenFlow, optical")
local made = {}
local structures = {
    path = format.path, description = format.description,
    tuning = format.tuning, statistics = format.statistics,
}
for name, structure in pairs(structures) do
    for _, field in ipairs(structure.fields) do make_field(made, "qof." .. name, field) end
end
local parts = format.parts
local part_structures = { parts.head }
for _, structure in pairs(parts.kinds) do part_structures[#part_structures + 1] = structure end
for _, structure in ipairs(part_structures) do
    for _, field in ipairs(structure.fields) do make_field(made, "qof.part", field) end
end
local port_number = ProtoField.uint32("qof.port", "port")
local fields = list_of(made)
fields[#fields + 1] = port_number
qof.fields = fields
local malformed = ProtoExpert.new(
    "qof.malformed", "malformed path optics", expert.group.MALFORMED, expert.severity.ERROR)
qof.experts = { malformed }

local PORT_STATUS, PORT_MOD, MULTIPART_REPLY = 12, 16, 19
local PORT_STATS, PORT_DESC, EXPERIMENTER = 4, 13, 0xffff

-- Adds what a property says of the part that an inner port leads to, if it is ours.
local function add_part(tree, property, port)
    local head = parts.head
    if property:len() < head.size or property:range(4, 4):uint() ~= format.experimenter
        or property:range(8, 4):uint() ~= parts.exp_type then
        return
    end
    local branch = tree:add(qof, property, "part behind port " .. port:uint())
    branch:add(port_number, port)
    local values = add_fields(branch, made, "qof.part", head.fields, property)
    local kind = parts.kinds[values.kind]
    if kind and property:len() == head.size + kind.size then
        add_fields(branch, made, "qof.part", kind.fields, property:range(head.size))
    end
end

-- Adds the optical property of a port, or our own, if there is one among its properties.
local function add_optical(tree, name, range, port)
    local structure, offset = structures[name], 0
    while offset + format.property <= range:len() do
        local kind = range:range(offset, 2):uint()
        local length = range:range(offset + 2, 2):uint()
        if length < format.property or offset + length > range:len() then return end
        if kind == format.optical and length == format.property + structure.size then
            local place = range:range(offset + format.property, structure.size)
            local branch = tree:add(qof, place, "optical " .. name .. " of port " .. port:uint())
            branch:add(port_number, port)
            add_fields(branch, made, "qof." .. name, structure.fields, place)
        elseif kind == parts.type and name == "description" then
            add_part(tree, range:range(offset, length), port)
        end
        offset = offset + math.floor((length + 7) / 8) * 8
    end
end

local function rest_of(range, offset)
    if offset < range:len() then return range:range(offset) end
    return nil
end

local function add_ports(tree, range, name, fixed, length_offset)
    while range and range:len() >= fixed do
        local length = range:range(length_offset, 2):uint()
        if length < fixed or length > range:len() then return end
        if length > fixed then
            add_optical(tree, name, range:range(fixed, length - fixed), range:range(0, 4))
        end
        range = rest_of(range, length)
    end
end

local function add_paths(tree, range)
    local size = format.path.size
    for offset = 0, range:len() - size, size do
        local place = range:range(offset, size)
        local values = add_fields(
            tree:add(qof, place, "optics of a path"), made, "qof.path", format.path.fields, place)
        if values.rotation > 3 or values.stuck > 1 then
            tree:add_proto_expert_info(malformed, "rotation or state of a path")
        end
    end
    if range:len() % size ~= 0 then
        tree:add_proto_expert_info(malformed, "path optics of " .. range:len() .. " bytes")
    end
end

local function add_experimenter(tree, range)
    if range:len() < 8 or range:range(0, 4):uint() ~= format.experimenter
        or range:range(4, 4):uint() ~= format.path_optics then
        return
    end
    local body = rest_of(range, 8)
    if body then add_paths(tree:add(qof, body, "path optics (experimenter QMN)"), body) end
end

-- Adds what one OpenFlow message says of light.
local function add_message(tree, message)
    local kind, size = message:range(1, 1):uint(), message:len()
    if kind == PORT_MOD and size > 32 then
        add_optical(tree, "tuning", message:range(32), message:range(8, 4))
    elseif kind == PORT_STATUS then
        add_ports(tree, rest_of(message, 16), "description", 40, 4)
    elseif kind == MULTIPART_REPLY and size > 16 then
        local part, body = message:range(8, 2):uint(), message:range(16)
        if part == PORT_DESC then add_ports(tree, body, "description", 40, 4)
        elseif part == PORT_STATS then
            -- of ofp_port_stats: length first, the port's number at 4
            while body and body:len() >= 80 do
                local length = body:range(0, 2):uint()
                if length < 80 or length > body:len() then return end
                if length > 80 then
                    add_optical(tree, "statistics", body:range(80, length - 80), body:range(4, 4))
                end
                body = rest_of(body, length)
            end
        elseif part == EXPERIMENTER then add_experimenter(tree, body)
        end
    end
end

local xid_field = Field.new("openflow_v5.xid")

function qof.dissector(_, _, tree)
    for _, xid in ipairs({ xid_field() }) do
        local range = xid.source:range(xid.offset - 4)
        local length = range:len() >= 8 and range:range(2, 2):uint() or 0
        if length >= 8 and length <= range:len() then add_message(tree, range:range(0, length)) end
    end
end

register_postdissector(qof)
