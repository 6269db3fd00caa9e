#!/bin/bash
# Makes kept_run.tar with a glasshouse of the first version: a run that was killed while it traced (half), one whose training was
# stopped between two steps (trained), and the digests of the files that the same program made of both in one go.
#
#     kept_run.sh GLASSHOUSE    # beside kept_run.toml; the photographs come to /data/photographs
set -eu
glasshouse=$1
here=$(cd "$(dirname "$0")" && pwd)
mkdir -p /data && cd /data
rm -rf photographs half trained whole
"$glasshouse" sample --count 6 --width 64 --height 48 photographs -q
cp "$here/kept_run.toml" .
"$glasshouse" run kept_run.toml --out whole --tile 16 -j 1 -q >/dev/null

# Partials of scenes without a tuple, one a line.
open_partials() {
    for folder in half/partials/*; do
        [ -e "half/tuples/$(basename "$folder")/tuple.json" ] || ls "$folder"/*.exr 2>/dev/null || true
    done
}
until [ "$(open_partials | wc -l)" -ge 3 ] && ls half/tuples/*/tuple.json >/dev/null 2>&1; do
    rm -rf half
    "$glasshouse" plan kept_run.toml --out half --tile 16 -q >/dev/null
    "$glasshouse" work half -j 1 -q --checkpoint-s 0 >/dev/null 2>&1 &
    sleep "0.$((RANDOM % 9 + 1))"
    kill -9 $! 2>/dev/null || true
    wait $! 2>/dev/null || true
done
# A few partials are enough.
open_partials | tail -n +4 | xargs -r rm

cp -r whole trained
rm -rf trained/report trained/logs trained/noise trained/train
"$glasshouse" train trained --stage backtrack --steps 4 --checkpoint-every 4 --pictures-every 0 -q >/dev/null
"$glasshouse" train trained --stage separation --steps 2 --checkpoint-every 2 --pictures-every 0 -q >/dev/null
find trained -name '*.lock' -delete
find half -name '*.lock' -delete
cd whole && find tuples train/*/step-0000004 -name '*.png' -o -name '*.exr' -o -name '*.safetensors' | sort | xargs sha256sum >../expected.txt && cd ..
tar --sort=name --owner=0 --group=0 --mtime=@0 -cf "$here/kept_run.tar" photographs half trained expected.txt
