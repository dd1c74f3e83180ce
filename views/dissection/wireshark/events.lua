-- Quantum events (wire/events.py): a magic number, a version and a protobuf message.

local format = formats.event
local qevent = Proto("qevent", "Quantum event")
local made = {}
local aliases = { ["block.session"] = "session" }

-- Wire type, and how a value is shown, of each protobuf type.
local types = {
    [1] = { 1, "double" }, [2] = { 5, "float" }, [3] = { 0, "int64" }, [4] = { 0, "uint64" },
    [5] = { 0, "int64" }, [6] = { 1, "uint64" }, [7] = { 5, "uint32" }, [8] = { 0, "bool" },
    [9] = { 2, "string" }, [11] = { 2, "message" }, [12] = { 2, "bytes" }, [13] = { 0, "uint32" },
    [14] = { 0, "enum" }, [15] = { 5, "int32" }, [16] = { 1, "int64" }, [17] = { 0, "zigzag" },
    [18] = { 0, "zigzag" },
}

local function describe(fields, path)
    for _, field in ipairs(fields) do
        local name = path .. field.name
        local abbreviation = "qevent." .. (aliases[name] or name)
        local title = (aliases[name] or name):gsub("[_.]", " ")
        local show = types[field.type] and types[field.type][2]
        if show == "message" then
            describe(field.fields, name .. ".")
        elseif show == "uint64" then
            local base_shown = abbreviation == "qevent.session" and base.HEX or base.DEC
            made[name] = ProtoField.uint64(abbreviation, title, base_shown)
        elseif show == "int64" or show == "zigzag" then
            made[name] = ProtoField.int64(abbreviation, title)
        elseif show == "enum" then
            made[name] = ProtoField.uint32(abbreviation, title, base.DEC, field.values)
        elseif show == "float" then
            made[name] = ProtoField.float(abbreviation, title)
        elseif show then
            made[name] = ProtoField[show](abbreviation, title)
        end
    end
end
describe(format.fields, "")

local version = ProtoField.uint8("qevent.version", "version")
local unknown = ProtoField.bytes("qevent.unknown", "field of a later version")
local fields = list_of(made)
fields[#fields + 1], fields[#fields + 2] = version, unknown
qevent.fields = fields
local malformed = ProtoExpert.new(
    "qevent.malformed", "malformed quantum event", expert.group.MALFORMED, expert.severity.ERROR)
qevent.experts = { malformed }

-- Returns a varint as UInt64 and the offset behind it, or nil.
local function varint(range, offset)
    local value = UInt64.new(0)
    for step = 0, 9 do
        if offset >= range:len() then return nil end
        local byte = range:range(offset, 1):uint()
        value = value:bor(UInt64.new(byte % 128):lshift(7 * step))
        offset = offset + 1
        if byte < 128 then return value, offset end
    end
    return nil
end

local fixed_sizes = { [1] = 8, [5] = 4 }

-- Returns where a field's value is and, for numbers of variable size, what it is.
local function read_value(range, offset, wire_type)
    local start = offset
    if wire_type == 0 then
        local value, next_offset = varint(range, offset)
        if not value then return nil end
        return start, next_offset - start, value, next_offset
    end
    local size = fixed_sizes[wire_type]
    if wire_type == 2 then
        local value, next_offset = varint(range, offset)
        if not value or value:higher() ~= 0 then return nil end
        start, size = next_offset, value:lower()
    end
    if not size or start + size > range:len() then return nil end
    return start, size, nil, start + size
end

local function unzigzag(value)
    local half = value:rshift(1)
    if value:band(UInt64.new(1)):lower() == 1 then half = half:bxor(UInt64.new(0):bnot()) end
    return Int64.new(half:lower(), half:higher())
end

local function add_value(tree, field, show, place, value)
    if not field then return end
    if show == "uint64" then tree:add(field, place, value or place:le_uint64())
    elseif show == "int64" and value then tree:add(field, place, Int64.new(value:lower(), value:higher()))
    elseif show == "int64" then tree:add(field, place, place:le_int64())
    elseif show == "zigzag" then tree:add(field, place, unzigzag(value))
    elseif show == "uint32" or show == "enum" then
        tree:add(field, place, value and value:lower() or place:le_uint())
    elseif show == "bool" then tree:add(field, place, value:tonumber() ~= 0)
    elseif show == "int32" then tree:add(field, place, place:le_int())
    elseif show == "float" or show == "double" then tree:add(field, place, place:le_float())
    elseif show == "string" then
        tree:add(field, place, place:raw())
    else tree:add(field, place) end
end

local add_message

-- Adds one field of a message; returns the offset behind it, or nil and why it is malformed.
local function add_field(tree, numbered, path, range, offset, seen)
    local key, behind = varint(range, offset)
    if not key then return nil, "a field's number is cut off" end
    local wire_type = key:band(UInt64.new(7)):lower()
    local number = key:rshift(3):tonumber()
    if number < 1 or number >= 2 ^ 29 then return nil, "field number " .. number end
    local start, size, value, next_offset = read_value(range, behind, wire_type)
    if not start then return nil, "field " .. number .. " does not fit" end
    local field, place = numbered[number], size > 0 and range:range(start, size)
    local expected, show = nil, nil
    if field and types[field.type] then expected, show = types[field.type][1], types[field.type][2] end
    if expected ~= wire_type and not (wire_type == 2 and expected and expected ~= 2) then
        tree:add(unknown, range:range(offset, next_offset - offset))
    elseif show == "message" then
        local problem = place and add_message(tree, field.fields, path .. field.name .. ".", place, seen)
        if problem then return nil, problem end
    elseif wire_type == 2 and expected ~= 2 then
        local at = start -- a packed list
        while at < start + size do
            local element, length, number_value, after = read_value(range, at, expected)
            if not element then return nil, "list " .. number .. " does not fit" end
            add_value(tree, made[path .. field.name], show, range:range(element, length), number_value)
            at = after
        end
    elseif place then
        if show == "string" then
            if not is_utf8(place:raw()) then return nil, field.name .. " is not UTF-8" end
            seen[path .. field.name] = place:raw()
        elseif show == "uint32" then
            seen[path .. field.name] = value and value:lower()
        end
        add_value(tree, made[path .. field.name], show, place, value)
    end
    return next_offset
end

function add_message(tree, described, path, range, seen)
    local numbered = {}
    for _, field in ipairs(described) do numbered[field.number] = field end
    local offset = 0
    while offset < range:len() do
        local next_offset, problem = add_field(tree, numbered, path, range, offset, seen)
        if not next_offset then return problem end
        offset = next_offset
    end
    return nil
end

local function summary(seen)
    local words = { seen.node or "?", seen.kind or "?" }
    if seen["block.number"] then
        words[#words + 1] = "block " .. seen["block.number"] .. "/" .. (seen["block.half"] or 0)
    end
    if seen.port then words[#words + 1] = seen.port end
    if seen.photons then words[#words + 1] = seen.photons .. " photons" end
    if seen.lost then words[#words + 1] = seen.lost .. " lost" end
    if seen.detail then words[#words + 1] = seen.detail end
    return table.concat(words, " ")
end

function qevent.dissector(buffer, pinfo, tree)
    pinfo.cols.protocol = "QEVENT"
    local item = tree:add(qevent, buffer:range())
    local problem, seen = nil, {}
    if is_cut(buffer) then
        item:append_text(", " .. CUT)
        pinfo.cols.info = CUT
        return buffer:len()
    end
    if buffer:len() < format.header or buffer:range(0, 2):uint() ~= format.magic then
        problem = "not a quantum event"
    elseif buffer:range(2, 1):uint() ~= format.version then
        problem = "version " .. buffer:range(2, 1):uint()
    else
        item:add(version, buffer:range(2, 1))
        if buffer:len() > format.header then
            problem = add_message(item, format.fields, "", buffer:range(format.header), seen)
        end
    end
    if problem then item:add_proto_expert_info(malformed, problem) end
    pinfo.cols.info = problem and "malformed: " .. problem or summary(seen)
    if seen.node then pinfo.cols.src = seen.node end
    return buffer:len()
end

DissectorTable.get("wtap_encap"):add(wtap.USER0, qevent)
