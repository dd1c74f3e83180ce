-- Datagrams between controller and node agents (wire/device.py). Their HMAC cannot be checked.

local format, header_size = formats.device, formats.metadata.header
local qdev = Proto("qdev", "Quantum device message")
local kinds, names, made = {}, {}, {}

for _, kind in ipairs(format.kinds) do
    kinds[kind.number], names[kind.number] = kind, kind.name
    for _, field in ipairs(kind.fields) do
        if field.name ~= "settings" then make_field(made, "qdev", field) end
    end
    for _, tail in ipairs(kind.tails) do
        for _, field in ipairs(tail.fields) do make_field(made, "qdev." .. tail.name, field) end
        if #tail.fields == 0 then make_field(made, "qdev", tail) end
    end
end
for _, field in ipairs(format.settings) do make_field(made, "qdev.settings", field) end

local header = {
    magic = ProtoField.uint16("qdev.magic", "magic", base.HEX),
    version = ProtoField.uint8("qdev.version", "version"),
    kind = ProtoField.uint8("qdev.kind", "kind", base.DEC, names),
    length = ProtoField.uint32("qdev.length", "length"),
    session = ProtoField.uint64("qdev.session", "request number"),
    host = ProtoField.string("qdev.host", "host"),
    number = ProtoField.uint64("qdev.number", "speaker's clock in ns"),
    hmac = ProtoField.bytes("qdev.hmac", "HMAC"),
}
local links = link_fields("qdev")
local fields = list_of(made)
for _, group in ipairs({ header, links }) do
    for _, field in pairs(group) do fields[#fields + 1] = field end
end
qdev.fields = fields

local malformed = ProtoExpert.new(
    "qdev.malformed", "malformed device message", expert.group.MALFORMED, expert.severity.ERROR)
qdev.experts = { malformed }

local ledger = new_ledger()
function qdev.init() ledger = new_ledger() end

-- Returns a padded name, or nil if it is not a name.
local function padded_name(range)
    local name = range:raw():gsub("%z+$", "")
    if name == "" or name:find("[^\32-\126]") then return nil end
    return name
end

-- Returns which of the fields for names is not a name, or nil.
local function check_names(fields, range)
    for _, field in ipairs(fields) do
        if field.kind == "text" and not padded_name(range:range(field.offset, field.size)) then
            return field.name .. " is not a name"
        end
    end
    return nil
end

-- Adds device settings; what is not set is not shown. Returns why they are malformed, or nil.
local function add_settings(tree, range)
    local branch, ranges = tree:add(qdev, range, "settings"), {}
    for _, limits in ipairs(format.ranges) do ranges[limits.name] = limits end
    for _, field in ipairs(format.settings) do
        local place = range:range(field.offset, field.size)
        local value, limits = place:uint(), ranges[field.name]
        if value ~= format.unset then
            branch:add(made["qdev.settings." .. field.name], place)
            if value < limits.least or value > limits.most then
                return field.name .. " is " .. value
            end
        end
    end
    return nil
end

-- Adds the elements that follow the fixed fields. Returns why they are malformed, or nil.
local function add_elements(tree, tail, range)
    for offset = 0, range:len() - 1, tail.size do
        local place = range:range(offset, tail.size)
        local branch = tree:add(qdev, place, (tail.name:gsub("s$", "")))
        add_fields(branch, made, "qdev." .. tail.name, tail.fields, place)
        local problem = check_names(tail.fields, place)
        if problem then return problem end
    end
    return nil
end

-- Returns why the size of the fields cannot be, or nil.
local function check_size(kind, size)
    local rest = size - kind.size
    local tail = kind.tails[1]
    if rest < 0 or (rest > 0 and not tail) then return kind.name .. " of " .. size .. " bytes" end
    local counts = tail and format.counts[tail.name]
    if counts then
        local count = rest / tail.size
        if rest % tail.size ~= 0 or count < counts.least or count > counts.most then
            return kind.name .. " of " .. size .. " bytes"
        end
    end
    return nil
end

-- Returns why a command for a link monitor is refused, or nil.
local function check_monitor(values, fields, range)
    local at = {}
    for _, field in ipairs(fields) do at[field.name] = range:range(field.offset, field.size) end
    if at.opener:uint() == at.acceptor:uint() then return "one host at both ends" end
    for _, name in ipairs({ "whole_error", "fraction", "false_alarm", "missed" }) do
        local value = values[name]
        if value ~= value or math.abs(value) == math.huge then return name .. " is not a number" end
    end
    return nil
end

-- Returns why the estimate of a session cannot be, or nil.
local function check_estimate(values)
    local low, value, high, most = values.low, values.value, values.high, format.most_estimate
    local right = low <= value and value <= high and -most <= low and high <= most
    return not right and "no estimate" or nil
end

local function add_body(tree, kind, range)
    local size = range and range:len() or 0
    local problem = check_size(kind, size)
    if problem or size == 0 then return problem, {} end
    local plain, settings = {}, nil
    for _, field in ipairs(kind.fields) do
        if field.name == "settings" then settings = field else plain[#plain + 1] = field end
    end
    local values = add_fields(tree, made, "qdev", plain, range)
    problem = unnamed(plain, values) or check_names(plain, range)
    if kind.name == "Answer" then problem = problem or check_answer(values) end
    if kind.name == "SessionEstimate" then problem = problem or check_estimate(values) end
    if kind.name == "MonitorCommand" then problem = problem or check_monitor(values, plain, range) end
    if settings then
        local place = range:range(settings.offset, settings.size)
        problem = problem or add_settings(tree, place)
    end
    local tail = kind.tails[1]
    if tail and size > kind.size then
        local rest = range:range(kind.size)
        if #tail.fields > 0 then
            problem = problem or add_elements(tree, tail, rest)
        else
            if is_utf8(rest:raw()) then tree:add(made["qdev." .. tail.name], rest, rest:raw())
            else problem = problem or "text is not UTF-8" end
        end
    end
    return problem, values
end

local function note_link(pinfo, kind, conversation)
    local answers = { Answer = true, DeviceReport = true, KeyRoute = true }
    if answers[kind.name] then
        answer(ledger, conversation, pinfo, 0, function() return true end)
    else
        ask(ledger, conversation, pinfo, 0, kind.name)
    end
end

local function dissect(buffer, pinfo, item)
    local size = buffer:len()
    local least = header_size + format.trailer + format.tag
    if size < least or size > format.max_length then return "datagram of " .. size .. " bytes" end
    item:add(header.magic, buffer:range(0, 2))
    item:add(header.version, buffer:range(2, 1))
    item:add(header.kind, buffer:range(3, 1))
    item:add(header.length, buffer:range(4, 4))
    item:add(header.session, buffer:range(8, 8))
    local length = size - format.trailer - format.tag
    local host_range = buffer:range(length, format.trailer - 8)
    local host = padded_name(host_range)
    if not host then return "name of a host" end
    item:add(header.host, host_range, host)
    item:add(header.number, buffer:range(length + format.trailer - 8, 8))
    item:add(header.hmac, buffer:range(size - format.tag, format.tag))
    local kind = kinds[buffer:range(3, 1):uint()]
    if buffer:range(0, 2):uint() ~= formats.metadata.magic
        or buffer:range(2, 1):uint() ~= formats.metadata.version
        or buffer:range(4, 4):uint() ~= length or not kind then
        return "header"
    end
    local body = length > header_size and buffer:range(header_size, length - header_size) or nil
    local problem = add_body(item, kind, body)
    pinfo.cols.info = kind.name .. " " .. host
    if problem then return problem end
    local session = tostring(buffer:range(8, 8):uint64())
    if session ~= "0" then
        local conversation = table.concat({ captured_on(), host, session }, "/")
        if not pinfo.visited then note_link(pinfo, kind, conversation) end
        add_links(ledger, item, links, pinfo, 0)
    end
    return nil
end

function qdev.dissector(buffer, pinfo, tree)
    pinfo.cols.protocol = "QDEV"
    local item = tree:add(qdev, buffer:range())
    if is_cut(buffer) then
        item:append_text(", " .. CUT)
        pinfo.cols.info = CUT
        return buffer:len()
    end
    local problem = dissect(buffer, pinfo, item)
    if problem then
        item:add_proto_expert_info(malformed, problem)
        pinfo.cols.info = "malformed: " .. problem
    end
    return buffer:len()
end

DissectorTable.get("udp.port"):add(format.port, qdev)
