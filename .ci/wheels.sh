#!/bin/sh
# Build a wheel and an sdist of the last commit, install each into an empty environment, and use it outside the checkout:
# the README's examples, and commands of every kind. Arguments: executables of Python, by default 3.11 to 3.13.
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
unset PYTHONPATH || true # or the checkout is imported
[ $# -gt 0 ] || set -- python3.11 python3.12 python3.13
git clone --quiet --no-hardlinks "$root" source
"$1" -m venv build
build/bin/python -m pip install --quiet build
build/bin/python -m build --outdir made source >build.log
for python in "$@"; do
    for package in made/*; do
        rm -rf venv first diagnosis ppo
        "$python" -m venv venv
        venv/bin/python -m pip install --quiet --constraint "$root/constraints.txt" "$package[train,diagnose]"
        venv/bin/python -m doctest -o NORMALIZE_WHITESPACE "$root/README.md"
        venv/bin/homeward range rusti --grade 5.71 --duty 0.367 >said
        venv/bin/homeward evaluate --env homeward/Survey-v0 --agents soc50 dmax_adaptive ppo --episodes 10 --out first >said
        venv/bin/homeward diagnose --out diagnosis >said
        venv/bin/homeward train --env homeward/OutAndBack-v0 --steps 4096 --n-envs 32 --n-steps 64 --batch-size 256 \
            --out ppo >said
        echo "$("$python" --version), ${package##*.}: all well"
    done
done
