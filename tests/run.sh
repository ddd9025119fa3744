#!/bin/sh
# run.sh COMMAND...: runs each command (a test program with its arguments, in one string), $JOBS of them at a time,
# shows what each one said in the order given, and ends with the line "N passed, N failed" over all of them.
#
# A command counts as many tests as cmocka's closing lines say. One that exits non-zero without a failed test (a crash,
# a time-out, a missing program) or that exits zero without any test counts as one failure. Exit 0 when nothing failed.
# $RUNNER stands before each command (valgrind); $SECONDS_EACH is the time limit.
set -u
logs=$(mktemp -d) || exit 1
trap 'rm -rf "$logs"' EXIT
export logs RUNNER="${RUNNER:-}" SECONDS_EACH="${SECONDS_EACH:-300}"

n=0
for command; do
    n=$((n + 1))
    printf '%s %s\0' "$n" "$command"
done | xargs -0 -P "${JOBS:-2}" -I{} sh -c '
    set -- $1
    n=$1
    shift
    start=$(date +%s)
    timeout "$SECONDS_EACH" $RUNNER "$@" > "$logs/$n.log" 2>&1
    echo "$? $(($(date +%s) - start))" > "$logs/$n.status"' sh {}

# The sum of the counts in cmocka's lines "[  PASSED  ] 5 test(s)." or "[  FAILED  ] 1 test(s), listed below:".
count() { sed -n "s/^\[  $1  \] \([0-9][0-9]*\) test(s).*/\1/p" "$2" | awk '{ n += $1 } END { print n + 0 }'; }

passed=0
failed=0
summary=
n=0
for command; do
    n=$((n + 1))
    log=$logs/$n.log
    read -r status seconds 2> /dev/null < "$logs/$n.status" || { status=127; seconds=0; }
    echo "-- $command ($seconds s)"
    [ -e "$log" ] || : > "$log"
    cat "$log"
    p=$(count PASSED "$log")
    f=$(count FAILED "$log")
    if [ "$f" = 0 ] && [ "$status" != 0 ]; then
        f=1
        echo "[  FAILED  ] $command: exit status $status"
    elif [ "$f" = 0 ] && [ "$p" = 0 ]; then
        f=1
        echo "[  FAILED  ] $command: ran no test"
    fi
    [ "$f" = 0 ] || summary="$summary
failed: $command"
    passed=$((passed + p))
    failed=$((failed + f))
done
echo "$summary"
echo "$passed passed, $failed failed"
[ "$failed" = 0 ] && [ "$passed" != 0 ]
