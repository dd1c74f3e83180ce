-- Shared by the dissectors: fields made of the tables, and values read by them.

-- Some bit operations and integers differ between the Lua versions of Wireshark 4; these do not.
local byte_sizes = { [1] = "uint8", [2] = "uint16", [4] = "uint32", [8] = "uint64" }

-- Whether the capture has kept a part of a packet alone: what is missing is no fault of its sender.
local function is_cut(buffer) return buffer:len() < buffer:reported_len() end
local CUT = "cut by the capture"

-- Returns the ProtoField of a described field, shared by all kinds that have one of its name.
local function make_field(made, prefix, field)
    local abbreviation = prefix .. "." .. field.name
    if made[abbreviation] then return made[abbreviation] end
    local title, kind = field.name:gsub("_", " "), field.kind
    local proto_field
    if kind == "ipv4" then
        proto_field = ProtoField.ipv4(abbreviation, title)
    elseif kind == "text" then
        proto_field = ProtoField.string(abbreviation, title)
    elseif kind == "bytes" or kind == "packed" then
        proto_field = ProtoField.bytes(abbreviation, title)
    elseif kind == "double" then
        proto_field = ProtoField.double(abbreviation, title)
    elseif kind == "int" then
        proto_field = ProtoField.int32(abbreviation, title)
    elseif field.size == 8 then
        proto_field = ProtoField.uint64(abbreviation, title)
    elseif field.name == "encoding" or field.name == "crc32" then
        proto_field = ProtoField.uint32(abbreviation, title, base.HEX)
    else
        proto_field = ProtoField.uint32(abbreviation, title, base.DEC, field.values)
    end
    made[abbreviation] = proto_field
    return proto_field
end

local function list_of(made)
    local list = {}
    for _, proto_field in pairs(made) do list[#list + 1] = proto_field end
    return list
end

-- Returns a number, a text with all its bytes, or nil where neither tells (64 bits, addresses).
local function value_in(range, field)
    if field.kind == "text" then return range:raw() end
    if field.kind == "int" then return range:int() end
    if field.kind == "double" then return range:float() end
    if field.kind == "uint" and field.size <= 4 then return range:uint() end
    return nil
end

-- Adds fields at their places to a tree; returns their numbers by name.
local function add_fields(tree, made, prefix, fields, range)
    local values = {}
    for _, field in ipairs(fields) do
        local place = range:range(field.offset, field.size)
        local item = made[prefix .. "." .. field.name]
        if field.kind == "text" then
            tree:add(item, place, (place:string():gsub("%z.*", "")))
        else
            tree:add(item, place)
        end
        values[field.name] = value_in(place, field)
    end
    return values
end

-- Returns why a number is not one of those that have names, or nil.
local function unnamed(fields, values)
    for _, field in ipairs(fields) do
        if field.values and not field.open and not field.values[values[field.name]] then
            return "unknown " .. field.name .. " " .. tostring(values[field.name])
        end
    end
    return nil
end

local function is_utf8(text)
    local place, size = 1, #text
    while place <= size do
        local first = text:byte(place)
        local more, least
        if first < 0x80 then more, least = 0, 0
        elseif first >= 0xC2 and first <= 0xDF then more, least = 1, 0x80
        elseif first >= 0xE0 and first <= 0xEF then more, least = 2, 0x800
        elseif first >= 0xF0 and first <= 0xF4 then more, least = 3, 0x10000
        else return false end
        if place + more > size then return false end
        local code = more == 0 and first or first % 2 ^ (6 - more)
        for step = 1, more do
            local byte = text:byte(place + step)
            if byte < 0x80 or byte > 0xBF then return false end
            code = code * 64 + byte % 64
        end
        if code < least or code > 0x10FFFF or (code >= 0xD800 and code <= 0xDFFF) then
            return false
        end
        place = place + more + 1
    end
    return true
end

-- Returns why a number does not map each symbol to an operator of its own, or nil.
local function bad_encoding(encoding)
    local seen = {}
    for _ = 1, 4 do
        seen[encoding % 4] = true
        encoding = math.floor(encoding / 4)
    end
    if seen[0] and seen[1] and seen[2] and seen[3] then return nil end
    return "encoding does not use each operator once"
end

-- Returns why an answer offers what there is not, or nil.
local function check_answer(values)
    if values.symbols == 0 and values.encoding == 0 then return nil end
    if values.symbols ~= 3 and values.symbols ~= 4 then return values.symbols .. " symbols" end
    return bad_encoding(values.encoding)
end

-- Pairs requests with answers. A packet may hold several messages; each has a key of its own.
local function new_ledger()
    return { waiting = {}, answers = {}, requests = {} }
end

local function message_key(pinfo, place) return pinfo.number .. ":" .. place end

local function ask(ledger, conversation, pinfo, place, what)
    local waiting = ledger.waiting[conversation] or {}
    ledger.waiting[conversation] = waiting
    waiting[#waiting + 1] = {
        key = message_key(pinfo, place), frame = pinfo.number, time = pinfo.rel_ts, what = what,
    }
end

local function answer(ledger, conversation, pinfo, place, fits)
    for position, request in ipairs(ledger.waiting[conversation] or {}) do
        if fits(request.what) then
            table.remove(ledger.waiting[conversation], position)
            ledger.answers[request.key] = pinfo.number
            ledger.requests[message_key(pinfo, place)] = request
            return
        end
    end
end

local function add_links(ledger, tree, links, pinfo, place)
    local key = message_key(pinfo, place)
    if ledger.answers[key] then
        tree:add(links.response_in, ledger.answers[key]):set_generated()
    end
    local request = ledger.requests[key]
    if request then
        tree:add(links.request_in, request.frame):set_generated()
        tree:add(links.response_ms, (pinfo.rel_ts - request.time) * 1000):set_generated()
    end
end

local function link_fields(prefix)
    return {
        response_in = ProtoField.framenum(
            prefix .. ".response_in", "response in", base.NONE, frametype.RESPONSE),
        request_in = ProtoField.framenum(
            prefix .. ".request_in", "request in", base.NONE, frametype.REQUEST),
        response_ms = ProtoField.double(prefix .. ".response_ms", "response time in ms"),
    }
end

local interface_field = Field.new("frame.interface_id")

-- The same packet may be captured on several links: requests and answers belong to one. While
-- Wireshark builds no tree it does not say which, nor does it show us but the first copy.
local function captured_on()
    local interface = interface_field()
    return interface and tostring(interface.value) or "0"
end

-- By the topic of envelopes: what reads the stream of bytes that they carry.
local readers = {}
