-- Messages of key distribution (applications/qkd/messages.py), a stream within envelopes of quantum metadata
-- that is cut anywhere. Their tags cannot be checked: who holds the keys does.

local format = formats.keys
local qkd = Proto("qkd", "Key distribution")
local kinds, names, made = {}, {}, {}

for _, kind in ipairs(format.kinds) do
    kinds[kind.number], names[kind.number] = kind, kind.name
    for _, field in ipairs(kind.fields) do make_field(made, "qkd", field) end
    for _, tail in ipairs(kind.tails) do make_field(made, "qkd", tail) end
end

local header = {
    magic = ProtoField.uint16("qkd.magic", "magic", base.HEX),
    version = ProtoField.uint8("qkd.version", "version"),
    kind = ProtoField.uint8("qkd.kind", "kind", base.DEC, names),
    message_length = ProtoField.uint32("qkd.message_length", "message length"),
    session = ProtoField.uint64("qkd.session", "session", base.HEX),
    sequence = ProtoField.uint32("qkd.sequence", "sequence"),
    authentication = ProtoField.bytes("qkd.authentication", "authentication tag"),
}
local fields = list_of(made)
for _, field in pairs(header) do fields[#fields + 1] = field end
qkd.fields = fields

local malformed = ProtoExpert.new(
    "qkd.malformed", "malformed key distribution", expert.group.MALFORMED, expert.severity.ERROR)
local aborted = ProtoExpert.new(
    "qkd.aborted", "no key", expert.group.RESPONSE_CODE, expert.severity.WARN)
qkd.experts = { malformed, aborted }

local ones = {}
for byte = 0, 255 do
    ones[byte] = byte % 2 + (ones[math.floor(byte / 2)] or 0)
end

local function count_ones(bytes)
    local count = 0
    for place = 1, #bytes do count = count + ones[bytes:byte(place)] end
    return count
end

local function check_proposal(values)
    for _, name in ipairs({ "test_fraction", "max_qber", "eps_sec", "eps_cor" }) do
        if not (values[name] > 0 and values[name] < 1) then return name .. " is not a fraction" end
    end
    if not (values.multi_photon >= 0 and values.multi_photon < 1) then
        return "multi_photon is not a fraction"
    end
    for _, name in ipairs({ "chsh_fraction", "chsh_margin" }) do
        if not (values[name] >= 0 and values[name] < 1) then return name .. " is not a fraction" end
    end
    return nil
end

local function check_sample(values)
    if values.size >= values.sifted then return values.size .. " of " .. values.sifted .. " bits" end
    return nil
end

local function check_intensities(values)
    local signal, weak, vacuum = values.signal_mean, values.weak_mean, values.vacuum_mean
    if not (vacuum >= 0 and vacuum < weak and weak + vacuum < signal
            and signal <= format.max_mean) then
        return "means are not a signal and decoys"
    end
    local sum = 0
    for _, name in ipairs({ "signal_share", "weak_share", "vacuum_share" }) do
        if not (values[name] > 0 and values[name] < 1) then return name .. " is not a share" end
        sum = sum + values[name]
    end
    if math.abs(sum - 1) > 1e-9 then return "shares do not add up to 1" end
    return nil
end

local checks = {
    Proposal = check_proposal, Sample = check_sample, Intensities = check_intensities
}

-- Returns whether one of the numbers of two bits each is 3.
local function has_three(bytes)
    for place = 1, #bytes do
        local byte = bytes:byte(place)
        for _ = 1, 4 do
            if byte % 4 == 3 then return true end
            byte = math.floor(byte / 4)
        end
    end
    return false
end

-- Returns why a number is out of its range, or nil.
local function out_of_range(kind, values)
    for name, range in pairs(format.ranges[kind.name]) do
        if values[name] < range.least or values[name] > range.most then
            return name .. " is " .. values[name]
        end
    end
    return nil
end

-- Adds packed numbers that a range begins with; returns how many bytes they are, or nil and why.
local function add_packed(tree, tail, values, range)
    local left = range and range:len() or 0
    local bits = tail.width * values[tail.count]
    local size = math.floor((bits + 7) / 8)
    if size > left then return nil, tail.name .. " do not fit" end
    values[tail.name] = 0
    if size == 0 then return 0 end
    local place = range:range(0, size)
    local bytes = place:raw()
    tree:add(made["qkd." .. tail.name], place)
    if bits % 8 > 0 and bytes:byte(size) % 2 ^ (8 - bits % 8) > 0 then
        return nil, "padding of " .. tail.name
    end
    if tail.name == "levels" and has_three(bytes) then return nil, "a level is 3" end
    values[tail.name] = count_ones(bytes)
    return size
end

local function rest_of(range, offset)
    if range and offset < range:len() then return range:range(offset) end
    return nil
end

local function add_text(tree, tail, range)
    if not range then return nil end
    if range:len() > format.max_text then return "text of " .. range:len() .. " bytes" end
    if not is_utf8(range:raw()) then return "text is not UTF-8" end
    tree:add(made["qkd." .. tail.name], range, range:raw())
    return nil
end

-- Adds the fields of a message; returns their numbers, and why it is malformed, if it is.
local function add_body(tree, kind, body)
    if not body or body:len() < kind.size then return {}, kind.name .. " is too short" end
    local values = add_fields(tree, made, "qkd", kind.fields, body)
    local check = checks[kind.name]
    local problem = unnamed(kind.fields, values) or out_of_range(kind, values)
        or (check and check(values))
    if problem then return values, problem end
    local rest = rest_of(body, kind.size)
    for _, tail in ipairs(kind.tails) do
        if tail.kind == "text" then return values, add_text(tree, tail, rest) end
        local size, wrong = add_packed(tree, tail, values, rest)
        if not size then return values, wrong end
        rest = rest_of(rest, size)
    end
    return values, rest and rest:len() .. " bytes too many"
end

-- Adds one whole message; returns what a list of packets says of it.
local function add_message(tree, range)
    local kind = kinds[range:range(3, 1):uint()]
    local item = tree:add(qkd, range, "Key distribution: " .. kind.name)
    local behind = range:len() - format.tag
    item:add(header.magic, range:range(0, 2))
    item:add(header.version, range:range(2, 1))
    item:add(header.kind, range:range(3, 1))
    item:add(header.message_length, range:range(4, 4))
    item:add(header.session, range:range(8, 8))
    item:add(header.sequence, range:range(16, 4))
    local body = behind > format.header and range:range(format.header, behind - format.header) or nil
    local values, problem = add_body(item, kind, body)
    item:add(header.authentication, range:range(behind, format.tag))
    if problem then
        item:add_proto_expert_info(malformed, problem)
        return kind.name .. " (malformed)"
    end
    if kind.name == "Abort" then item:add_proto_expert_info(aborted) end
    return values.block and kind.name .. " block " .. values.block or kind.name
end

-- Returns how long the message is that bytes begin with; nil if more bytes are needed, nil and
-- why if they cannot be one.
local function message_length(bytes)
    local magic = string.char(math.floor(format.magic / 256), format.magic % 256)
    if bytes:sub(1, 2) ~= magic:sub(1, math.min(#bytes, 2)) then return nil, "not key distribution" end
    if #bytes < format.header then return nil end
    local version, kind = bytes:byte(3, 4)
    if version ~= format.version then return nil, "version " .. version end
    if not kinds[kind] then return nil, "unknown kind " .. kind end
    local length = 0
    for place = 5, 8 do length = 256 * length + bytes:byte(place) end
    if length < format.header + format.tag or length > format.max_length then
        return nil, "length " .. length
    end
    return length
end

-- Parts of messages in each direction of a connection; and, by envelope, the messages that were
-- whole then.
local waiting, whole = {}, {}
function qkd.init() waiting, whole = {}, {} end

-- Takes the next bytes of a stream; returns the messages that are whole now, and what is wrong.
local function feed(stream, bytes)
    local messages, problem = {}, nil
    local parts = waiting[stream] or { size = 0, needed = 0 }
    parts[#parts + 1], parts.size = bytes, parts.size + #bytes
    waiting[stream] = parts
    if parts.size < parts.needed then return { messages = messages } end
    local data, offset, length = table.concat(parts), 0, nil
    while true do
        length, problem = message_length(data:sub(offset + 1, offset + format.header))
        if not length or offset + length > #data then break end
        messages[#messages + 1] = data:sub(offset + 1, offset + length)
        offset = offset + length
    end
    local rest = data:sub(offset + 1)
    waiting[stream] = not problem and { rest, size = #rest, needed = length or 0 } or nil
    return { messages = messages, problem = problem }
end

local reader = {}

-- Forgets what a connection carried before this one, between the same ports.
function reader.begin(stream) waiting[stream] = nil end

-- Adds what an envelope makes whole; returns what a list of packets says of it.
function reader.add(tree, range, stream, key)
    if not whole[key] then whole[key] = feed(stream, range:raw()) end
    local words = {}
    for _, message in ipairs(whole[key].messages) do
        local data = ByteArray.new(message, true):tvb("Key distribution")
        words[#words + 1] = add_message(tree, data:range())
    end
    if whole[key].problem then
        local item = tree:add(qkd, range, "Key distribution: malformed")
        item:add_proto_expert_info(malformed, whole[key].problem)
        words[#words + 1] = "malformed"
    end
    return table.concat(words, ", ")
end

readers[format.topic] = reader
