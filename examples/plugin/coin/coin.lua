-- Tallies of coins (coin/tally.py), each in an envelope of quantum metadata.

local format = formats.coin
local coin = Proto("coin", "Common coins")
local thrown = ProtoField.uint32("coin.thrown", "thrown")
local agreed = ProtoField.uint32("coin.agreed", "agreed")
coin.fields = { thrown, agreed }
local malformed = ProtoExpert.new(
    "coin.malformed", "malformed tally", expert.group.MALFORMED, expert.severity.ERROR)
coin.experts = { malformed }

local reader = {}

function reader.begin(_) end

-- Adds what is in an envelope; returns what a list of packets says of it.
function reader.add(tree, range, _, _)
    local item = tree:add(coin, range, "Tally")
    if range:len() ~= format.size or range(4, 4):uint() > range(0, 4):uint() then
        item:add_proto_expert_info(malformed)
        return "malformed tally"
    end
    item:add(thrown, range(0, 4))
    item:add(agreed, range(4, 4))
    return range(4, 4):uint() .. " of " .. range(0, 4):uint() .. " coins alike"
end

readers[format.topic] = reader
