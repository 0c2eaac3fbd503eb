#!/bin/sh
# lock.sh FOLDER [OPTIONS OF uv pip compile]: writes build.txt, run.txt, test.txt and dds.txt: every package, direct or
# not, with its hashes. PYTHON names the interpreter; the resolver, uv, comes into an environment of its own, .locks/uv.
set -eu
cd "$(dirname "$0")/.."
uv=.locks/uv/bin/uv
if [ ! -x "$uv" ]; then
    "${PYTHON:-python3}" -m venv --clear .locks/uv
    .locks/uv/bin/python -m pip --disable-pip-version-check install --quiet 'uv==0.13.9'
fi
folder=$1
shift
mkdir -p "$folder"
compile() {
    UV_CUSTOM_COMPILE_COMMAND='make lock' "$uv" pip compile --quiet --generate-hashes --no-annotate \
        --no-emit-index-url --no-emit-find-links "$@"
}
compile "$@" setup.py requirements/build.in --extra ros --extra test -o "$folder/test.txt"
compile "$@" setup.py requirements/build.in --extra ros -c "$folder/test.txt" -o "$folder/run.txt"
compile "$@" requirements/build.in -c "$folder/test.txt" -o "$folder/build.txt"
compile "$@" requirements/dds.in -o "$folder/dds.txt"
