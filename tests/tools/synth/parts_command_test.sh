#!/usr/bin/env bash
# weft synth parts from end to end, small: parts_command_test.sh FOLDER-OF-PROGRAMS
set -euo pipefail
fail() { echo "FAILED: $*" >&2; exit 1; }
weft=$1/weft
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
parts() {
  "$weft" synth parts --seed 3 --jobs 1 --set simulation.garments=[towel] --set simulation.state_shares=[1,0,0,0] \
    --set simulation.held_out_share=0 --set render.samples=1 "$@"
}

# Without Blender: what to do about it.
status=0
PATH=$work parts --scenes 1 --out none 2>none.txt || status=$?
[ $status -eq 1 ] || fail "status $status without Blender"
grep -q "apt-get install blender" none.txt || fail "no remedy without Blender: $(cat none.txt)"

command -v blender >/dev/null || { echo "SKIPPED: Blender is not installed"; exit 0; }

parts --scenes 2 --out whole >summary.txt
cmp summary.txt whole/summary.txt
grep -q "^2 scenes of 1 simulations" summary.txt || fail "summary: $(cat summary.txt)"
[ -z "$(find whole -name '*.tmp')" ] || fail "temporary files are left"

# Stopped by Ctrl-C: in order, without a trace of Blender.
start() {  # FOLDER: in the background; sets child and blender
  setsid "$weft" synth parts --seed 3 --jobs 1 --set simulation.garments=[towel] \
    --set simulation.state_shares=[1,0,0,0] --set simulation.held_out_share=0 --set render.samples=1 \
    --scenes 2 --out "$1" >/dev/null 2>"$1.txt" &
  child=$!
  blender=
  for _ in $(seq 600); do
    blender=$(grep -ls "^PPid:[[:space:]]*$child\$" /proc/[0-9]*/status | head -1 | tr -dc 0-9 || true)
    [ -z "$blender" ] || ! grep -qs main.py /proc/$blender/cmdline || break  # not when it only tells its version
    blender=
    sleep 0.05
  done
  [ -n "$blender" ] || fail "Blender was not started: $(cat "$1.txt")"
}
start cut
kill -INT $child
status=0
wait $child || status=$?
[ $status -eq 130 ] || fail "status $status after SIGINT: $(cat cut.txt)"
! kill -0 $blender 2>/dev/null || fail "Blender is left after SIGINT"
grep -q "goes on from here" cut.txt || fail "no word of going on: $(cat cut.txt)"

# Killed while Blender simulates: its process goes, too, and the next run ends with the same folder.
start cut
kill -9 $child
wait $child 2>/dev/null || true
for _ in $(seq 100); do
  kill -0 $blender 2>/dev/null || break
  sleep 0.05
done
! kill -0 $blender 2>/dev/null || fail "Blender outlived the program that started it"
parts --scenes 2 --out cut >/dev/null 2>&1
diff -r whole cut || fail "not the same folder after a kill"

# A simulation that crashes Blender again and again is given up and counted; the next one takes its place.
mkdir bin
cat >bin/blender <<EOF
#!/bin/sh
case "\$*" in
  *"--index 0 "*) kill -SEGV \$\$ ;;
  *) exec $(command -v blender) "\$@" ;;
esac
EOF
chmod +x bin/blender
PATH=$work/bin:$PATH parts --scenes 2 --out crash >crash.txt 2>&1
grep -q "rejected poses: 3 (Blender crashed 3); garments given up: 1" crash.txt || fail "crash: $(cat crash.txt)"
[ -e crash/simulations/3-00001.wsim ] || fail "no garment took the place of the one that crashed"
