# Turns index.js of npm's package "bunny" into OBJ: exports.positions=[[x,y,z],...] and exports.cells=[[a,b,c],...].
BEGIN { RS = "]" }
/positions/ { kind = "v" }
/cells/ { kind = "f" }
{
    sub(/.*\[/, "")
    if (split($0, n, ",") != 3 || kind == "") next
    if (kind == "v") print "v", n[1], n[2], n[3]
    else print "f", n[1] + 1, n[2] + 1, n[3] + 1 # OBJ counts from one
}
