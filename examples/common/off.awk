# From OBJ of triangles, given twice, to OFF: awk -f off.awk model.obj model.obj
NR == FNR { count[$1]++; next }
FNR == 1 { print "OFF"; print count["v"], count["f"], 0 }
$1 == "v" { print $2, $3, $4 }
$1 == "f" { print 3, $2 - 1, $3 - 1, $4 - 1 }
