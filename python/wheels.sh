#!/usr/bin/env bash
# Builds wheels for distribution into python/dist, one for each target, for CPython 3.10 and newer.
#
#     pip install maturin ziglang cargo-zigbuild
#     python/wheels.sh [TARGET...]         # default x86_64-unknown-linux-gnu
#
# On Linux, zig links with the symbols of glibc 2.28 (2018), so that a wheel also runs on older systems (manylinux_2_28).
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")"
glibc=2.28
targets=("$@")
[ ${#targets[@]} -gt 0 ] || targets=(x86_64-unknown-linux-gnu)
folder=$(cargo metadata --format-version 1 --no-deps | python3 -c 'import json, sys; print(json.load(sys.stdin)["target_directory"])')
scripts=glasshouse.data/scripts
trap 'rm -rf "$scripts"' EXIT
for target in "${targets[@]}"; do
    # Both packages, as in backend/glasshouse_build.py.
    arguments=(--profile dist --locked --package glasshouse --package glasshouse-python --bin glasshouse)
    case $target in
    *-linux-gnu)
        cargo zigbuild "${arguments[@]}" --target "$target.$glibc"
        how=(--zig --compatibility "manylinux_${glibc/./_}")
        ;;
    *)
        cargo build "${arguments[@]}" --target "$target"
        how=()
        ;;
    esac
    mkdir -p "$scripts"
    cp "$folder/$target/dist/glasshouse" "$scripts/"
    maturin build --profile dist --locked --target "$target" "${how[@]}" --out dist
done
ls -l dist
