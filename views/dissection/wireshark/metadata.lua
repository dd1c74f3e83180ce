-- Quantum metadata over TCP (wire/metadata/).

local format = formats.metadata
local qmeta = Proto("qmeta", "Quantum metadata")
local kinds, names, made = {}, {}, {}
local MOST_VALUES = 32 -- that are shown one by one

for _, kind in ipairs(format.kinds) do
    kinds[kind.number], names[kind.number] = kind, kind.name
    for _, field in ipairs(kind.fields) do make_field(made, "qmeta", field) end
    for _, tail in ipairs(kind.tails) do
        if #tail.fields == 0 then
            make_field(made, "qmeta", tail)
        elseif #tail.fields == 1 then
            made["qmeta." .. tail.name] = ProtoField.uint32("qmeta." .. tail.name, tail.name)
        else
            for _, field in ipairs(tail.fields) do make_field(made, "qmeta." .. tail.name, field) end
        end
    end
end

local header = {
    magic = ProtoField.uint16("qmeta.magic", "magic", base.HEX),
    version = ProtoField.uint8("qmeta.version", "version"),
    kind = ProtoField.uint8("qmeta.kind", "kind", base.DEC, names),
    length = ProtoField.uint32("qmeta.length", "length"),
    session = ProtoField.uint64("qmeta.session", "session", base.HEX),
}
local derived = {
    value = ProtoField.uint32("qmeta.value", "value"),
    opener = ProtoField.string("qmeta.opener", "opener"),
}
local links = link_fields("qmeta")
local fields = list_of(made)
for _, group in ipairs({ header, derived, links }) do
    for _, field in pairs(group) do fields[#fields + 1] = field end
end
qmeta.fields = fields

local malformed = ProtoExpert.new(
    "qmeta.malformed", "malformed quantum metadata", expert.group.MALFORMED, expert.severity.ERROR)
local refused = ProtoExpert.new(
    "qmeta.refused", "refused", expert.group.RESPONSE_CODE, expert.severity.WARN)
qmeta.experts = { malformed, refused }

-- Of each direction of a connection: the first packet of which the capture has a part alone.
local first_cut = {}
local ledger, dissected = new_ledger(), {}
function qmeta.init() ledger, dissected, first_cut = new_ledger(), {}, {} end

-- Returns why a set-up message asks for what there is not, or nil.
local function check_setup(values)
    for _, name in ipairs({ "pairs", "frame_bytes", "rate_hz" }) do
        if values[name] == 0 then return name .. " is 0" end
    end
    if values.interleave > 1 then return "interleave is " .. values.interleave end
    if values.obstacle:gsub("%z+$", ""):find("[^ -~]") then return "obstacle is not ASCII" end
    return bad_encoding(values.encoding)
end

local function check_block(values, tree_values)
    if values.pairs < values.refills + #tree_values.frames then
        return "pairs do not carry what is listed"
    end
    return nil
end

local function check_report(values, _, left, body)
    if left ~= 0 and left ~= math.floor((values.pairs + 7) / 8) then
        return left .. " bytes of lost pairs do not fit"
    end
    local again = 0
    for place = body:len() - left, body:len() - 1 do
        local byte = body:range(place, 1):uint()
        while byte > 0 do
            again = again + byte % 2
            byte = math.floor(byte / 2)
        end
    end
    if again > values.lost or values.lost > values.pairs then
        return values.lost .. " of " .. values.pairs .. " pairs lost"
    end
    return nil
end

local function check_values(values, _, left, body)
    if not format.widths[values.width] then return values.width .. " bits a value" end
    local bits = values.count * values.width
    if left ~= math.floor((bits + 7) / 8) then
        return values.count .. " of " .. values.width .. " bits are not " .. left .. " bytes"
    end
    if bits % 8 > 0 and body:range(body:len() - 1, 1):uint() % 2 ^ (8 - bits % 8) > 0 then
        return "bits behind the last value are not 0"
    end
    return nil
end

local checks = {
    Setup = check_setup,
    Answer = check_answer,
    Block = check_block,
    Report = check_report,
    Values = check_values,
}
-- Nobody answers these one by one, but for values of some topics.
local unanswered = { Values = true, Envelope = true, Emission = true }
local answered_topics = {}
for _, topic in ipairs(format.answered) do answered_topics[topic] = true end

-- Adds a list of elements; returns what they hold, and what is left behind them.
local function add_elements(tree, tail, count, rest)
    local elements = {}
    for number = 0, count - 1 do
        local place = rest:range(number * tail.size, tail.size)
        if #tail.fields == 1 then
            tree:add(made["qmeta." .. tail.name], place)
            elements[#elements + 1] = place:uint()
        else
            local text = tail.name:gsub("s$", "") .. " " .. (number + 1)
            local branch = tree:add(qmeta, place, text)
            elements[#elements + 1] =
                add_fields(branch, made, "qmeta." .. tail.name, tail.fields, place)
        end
    end
    return elements
end

local function remainder(range, offset)
    if offset < range:len() then return range:range(offset) end
    return nil
end

-- Adds the fields of a message; returns their numbers, and why it is malformed, if it is.
local function add_body(tree, kind, body)
    local size = body and body:len() or 0
    if size < kind.size or (#kind.tails == 0 and size > kind.size) then
        return {}, kind.name .. " with fields of " .. size .. " bytes"
    end
    local values = size > 0 and add_fields(tree, made, "qmeta", kind.fields, body) or {}
    local problem, offset, lists = unnamed(kind.fields, values), kind.size, {}
    for _, tail in ipairs(kind.tails) do
        local rest = remainder(body, offset)
        local left = rest and rest:len() or 0
        if tail.kind == "counted" then
            local count = values[tail.name .. "_count"]
            if tail.name == "frames" and count > format.max_frames then
                return values, count .. " frames"
            end
            if count * tail.size > left then return values, count .. " " .. tail.name .. " do not fit" end
            lists[tail.name] = count > 0 and add_elements(tree, tail, count, rest) or {}
            offset = offset + count * tail.size
        elseif rest then
            local item = made["qmeta." .. tail.name]
            if tail.kind == "bytes" then tree:add(item, rest)
            elseif is_utf8(rest:raw()) then tree:add(item, rest, rest:raw())
            else problem = "text is not UTF-8" end
        end
        if tail.kind ~= "counted" then offset = size end
    end
    if #kind.tails == 1 and offset < size then
        return values, (size - offset) .. " bytes too many"
    end
    local tail_offset = kind.size
    for _, tail in ipairs(kind.tails) do
        if tail.kind == "counted" then
            tail_offset = tail_offset + values[tail.name .. "_count"] * tail.size
        end
    end
    local check = checks[kind.name]
    return values, problem or (check and check(values, lists, size - tail_offset, body))
end

local function end_of(address, port) return tostring(address) .. ":" .. port end

local function note_link(pinfo, place, kind, values)
    local source, destination = end_of(pinfo.src, pinfo.src_port), end_of(pinfo.dst, pinfo.dst_port)
    local asked = table.concat({ captured_on(), source, destination }, " ")
    local answered = table.concat({ captured_on(), destination, source }, " ")
    if kind.name == "Answer" then
        local function fits(what) return what.kind ~= "Block" end
        answer(ledger, answered, pinfo, place, fits)
    elseif kind.name == "Report" then
        local function fits(what) return what.kind == "Block" and what.block == values.block end
        answer(ledger, answered, pinfo, place, fits)
    elseif not unanswered[kind.name] or answered_topics[values.topic] then
        ask(ledger, asked, pinfo, place, { kind = kind.name, block = values.block })
    end
end

-- Adds the first numbers that a message carries, one by one.
local function add_numbers(tree, values, data)
    local width = values.width
    for number = 0, math.min(values.count, MOST_VALUES) - 1 do
        local first = number * width
        local place = data:range(math.floor(first / 8), math.max(width / 8, 1))
        local value = place:uint()
        if width < 8 then
            value = math.floor(value / 2 ^ (8 - width - first % 8)) % 2 ^ width
        end
        tree:add(derived.value, place, value)
    end
end

-- Adds what is in an envelope, if that is known here; returns what a list of packets says of it.
local function add_content(trees, topic, content, pinfo, place, copy)
    if topic == format.opener and is_utf8(content:raw()) then
        trees.own:add(derived.opener, content, content:raw())
        return content:raw()
    end
    if not readers[topic] or copy then return "" end
    local source, destination = end_of(pinfo.src, pinfo.src_port), end_of(pinfo.dst, pinfo.dst_port)
    local stream = source .. " " .. destination
    return readers[topic].add(trees.outer, content, stream, message_key(pinfo, place))
end

-- Lets those that read streams forget what came before on a connection that begins.
local function begin(pinfo)
    local source, destination = end_of(pinfo.src, pinfo.src_port), end_of(pinfo.dst, pinfo.dst_port)
    for _, reader in pairs(readers) do
        reader.begin(source .. " " .. destination)
        reader.begin(destination .. " " .. source)
    end
end

local function summary(kind, values)
    local words = { kind.name }
    for _, field in ipairs(kind.fields) do
        local value = values[field.name]
        if field.name == "topic" then
            words[#words + 1] = field.values[value] or value
        elseif field.name == "service" or field.name == "handshake" or field.name == "verdict" then
            words[#words + 1] = field.values[value]
        elseif field.name == "reason" and value ~= 0 then
            words[#words + 1] = field.values[value]
        elseif field.name == "block" and kind.name ~= "Setup" then
            words[#words + 1] = "block " .. value
        elseif field.name == "pairs" and kind.name ~= "Setup" then
            words[#words + 1] = value .. " pairs"
        end
    end
    return table.concat(words, " ")
end

-- Dissects one whole message.
local function add_message(buffer, pinfo, tree, place, copy, cut)
    local kind = kinds[buffer:range(3, 1):uint()]
    local item = tree:add(qmeta, buffer:range(), "Quantum metadata: " .. kind.name)
    item:add(header.magic, buffer:range(0, 2))
    item:add(header.version, buffer:range(2, 1))
    item:add(header.kind, buffer:range(3, 1))
    item:add(header.length, buffer:range(4, 4))
    item:add(header.session, buffer:range(8, 8))
    local values, problem = add_body(item, kind, remainder(buffer:range(), format.header))
    if problem then
        item:add_proto_expert_info(malformed, problem)
        return kind.name .. " (malformed)"
    end
    if values.reason and values.reason ~= 0 then item:add_proto_expert_info(refused) end
    if not pinfo.visited then
        note_link(pinfo, place, kind, values)
        if kind.name == "Setup" and not copy then begin(pinfo) end
    end
    add_links(ledger, item, links, pinfo, place)
    local words, data = summary(kind, values), remainder(buffer:range(), format.header + kind.size)
    if kind.name == "Values" and data then
        add_numbers(item, values, data)
    elseif kind.name == "Envelope" and data then
        local trees = { own = item, outer = tree }
        words = words .. " " .. add_content(trees, values.topic, data, pinfo, place, copy or cut)
    end
    return words
end

-- Returns the length of the message that bytes begin with; nil and true if more are needed,
-- nil, false and why if they cannot be one.
local function message_length(range)
    local size = range:len()
    local magic = range:range(0, math.min(size, 2)):uint()
    if magic ~= (size == 1 and math.floor(format.magic / 256) or format.magic) then
        return nil, false, "not quantum metadata"
    end
    if size < format.header then return nil, true end
    local version, kind = range:range(2, 1):uint(), range:range(3, 1):uint()
    if version ~= format.version then return nil, false, "version " .. version end
    if not kinds[kind] then return nil, false, "unknown kind " .. kind end
    local length = range:range(4, 4):uint()
    if length < format.header or length > format.max_length then
        return nil, false, "length " .. length
    end
    return length
end

local function mark(tree, range, problem)
    tree:add(qmeta, range, "Quantum metadata: malformed"):add_proto_expert_info(malformed, problem)
end

local function mark_cut(tree, range) tree:add(qmeta, range, "Quantum metadata: " .. CUT) end

-- Whether bytes are missing of what one end has sent until here: messages begin anywhere then.
local function behind_cut(buffer, pinfo)
    local stream = end_of(pinfo.src, pinfo.src_port) .. " " .. end_of(pinfo.dst, pinfo.dst_port)
    if is_cut(buffer) and not pinfo.visited then
        first_cut[stream] = first_cut[stream] or pinfo.number
    end
    return first_cut[stream] and first_cut[stream] <= pinfo.number
end

function qmeta.dissector(buffer, pinfo, tree)
    dissected[pinfo.number] = true
    pinfo.cols.protocol = "QMETA"
    local offset, summaries, cut = 0, {}, behind_cut(buffer, pinfo)
    while offset < buffer:len() do
        local rest = buffer:range(offset)
        local length, more, problem = message_length(rest)
        if problem or is_cut(buffer) and (more or length > rest:len()) then
            if cut then mark_cut(tree, rest) else mark(tree, rest, problem) end
            summaries[#summaries + 1] = cut and CUT or "malformed"
            break
        end
        if more or length > rest:len() then
            pinfo.desegment_offset = offset
            pinfo.desegment_len = more and DESEGMENT_ONE_MORE_SEGMENT or length - rest:len()
            break
        end
        summaries[#summaries + 1] = add_message(
            buffer(offset, length):tvb(), pinfo, tree, offset, false, cut)
        offset = offset + length
    end
    if #summaries > 0 then pinfo.cols.info = table.concat(summaries, ", ") end
    return buffer:len()
end

DissectorTable.get("tcp.port"):add(format.port, qmeta)

-- In a merged capture every link of a switch has a copy of a packet, and Wireshark's TCP hands
-- on only the first. The others matter, too: the controller writes into set-up messages.
local again = Proto("qmeta_again", "Quantum metadata on a further link")
local payload_field = Field.new("tcp.payload")

function again.dissector(frame, pinfo, tree)
    local payload = payload_field()
    if not payload or dissected[pinfo.number] then return end
    if pinfo.src_port ~= format.port and pinfo.dst_port ~= format.port then return end
    if frame:range(0, 6):bytes():tohex(true) == format.switches then
        pinfo.cols.protocol, pinfo.cols.info = "QMETA", "copy for quantum switches"
        return -- filters by fields find the message once
    end
    local range, offset, summaries = payload.range, 0, {}
    while offset < range:len() do
        local rest = range:range(offset)
        local length = message_length(rest)
        if not length or length > rest:len() then break end
        local message = rest:range(0, length):tvb()
        summaries[#summaries + 1] = add_message(message, pinfo, tree, offset, true)
        offset = offset + length
    end
    if #summaries > 0 then
        pinfo.cols.protocol = "QMETA"
        pinfo.cols.info = table.concat(summaries, ", ")
    end
end

register_postdissector(again)
