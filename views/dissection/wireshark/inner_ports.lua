-- Frames of and to the inner ports of quantum switches (wire/analyser_frames.py).

local format = formats.inner
local qinner = Proto("qinner", "Inner port of a quantum switch")
local made, kinds = {}, {}
for _, kind in ipairs(format.kinds) do
    kinds[kind.magic] = kind
    for _, field in ipairs(kind.fields) do make_field(made, "qinner", field) end
end
local outcome = ProtoField.uint8("qinner.outcome", "outcome", base.DEC, format.outcomes)
local fields = list_of(made)
fields[#fields + 1] = outcome
qinner.fields = fields
local malformed = ProtoExpert.new(
    "qinner.malformed", "malformed frame", expert.group.MALFORMED, expert.severity.ERROR)
qinner.experts = { malformed }

-- Adds outcomes, two a byte; returns why they cannot be, or nil.
local function add_outcomes(tree, range, count, method)
    if range:len() < math.ceil(count / 2) then return "fewer outcomes than it says" end
    for place = 0, count - 1 do
        local byte = range:range(math.floor(place / 2), 1)
        local value = place % 2 == 0 and math.floor(byte:uint() / 16) or byte:uint() % 16
        local turned = value >= format.turned and value < 15
        if not format.outcomes[value] or (turned and method == 0) then return "outcome " .. value end
        tree:add(outcome, byte, value)
    end
    return nil
end

function qinner.dissector(buffer, pinfo, tree)
    pinfo.cols.protocol = "qinner"
    local root = tree:add(qinner, buffer())
    if is_cut(buffer) then return root:append_text(" (" .. CUT .. ")") end
    local kind = buffer:len() >= 4 and kinds[buffer:range(0, 4):string()]
    if not kind or buffer:len() < kind.size then
        return root:add_proto_expert_info(malformed, "neither outcomes nor an order to a source")
    end
    local values = add_fields(root, made, "qinner", kind.fields, buffer)
    local wrong = unnamed(kind.fields, values)
    if not wrong and values.count then
        wrong = add_outcomes(root, buffer:range(kind.size), values.count, values.method)
        pinfo.cols.info = string.format("%s: %d of %d pulses, block %d at inner port %d",
            format.ends[values["end"]] or "?", values.count, values.pulses, values.number, values.port)
    elseif not wrong then
        pinfo.cols.info = string.format("Emit %d pairs, block %d", values.pairs, values.number)
    end
    if wrong then root:add_proto_expert_info(malformed, wrong) end
end

for _, ether_type in ipairs(format.types) do
    DissectorTable.get("ethertype"):add(ether_type, qinner)
end
