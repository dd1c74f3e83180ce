-- gRPC to the dispatcher is HTTP/2. The messages are in dispatcher.proto, beside the captures:
-- tshark -o 'uat:protobuf_search_paths:"FOLDER","TRUE"' reads it there.
DissectorTable.get("tcp.port"):add(formats.grpc.port, Dissector.get("http2"))
