-- OpenFlow by TLS, on the same port as plain OpenFlow, known by the first byte, which is the
-- version (1 to 6) in OpenFlow and the kind of a record (20 to 23) in TLS.

local port = formats.openflow.port
local either = Proto("qoftls", "OpenFlow, plain or by TLS")
local plain, tls = Dissector.get("openflow"), Dissector.get("tls")

function either.dissector(buffer, pinfo, tree)
    local first = buffer(0, 1):uint()
    local inner = (first >= 20 and first <= 23) and tls or plain
    return inner:call(buffer, pinfo, tree)
end

DissectorTable.get("tcp.port"):add(port, either)
DissectorTable.get("tls.port"):add(port, plain)
