#!/usr/bin/env bash
# What `./dev wheel --prove` runs: installs the wheel in a bare Debian and does there what a newcomer does, as a user without
# root. Nothing is there but python3 and python3-venv.
#   packaging/prove.sh [bookworm|trixie]...
# Needs root and debootstrap. pip's configuration and network settings of this machine are used inside, and nothing else of it.
set -euo pipefail
cd "$(dirname "$0")/.."
[ "$(id -u)" -eq 0 ] || { echo "prove: making a bare system needs root" >&2; exit 2; }
[ $# -gt 0 ] || set -- bookworm trixie
mirror=$(grep -hE '^(URIs:|deb )' /etc/apt/sources.list /etc/apt/sources.list.d/* 2>/dev/null |
  grep -oE 'https?://[^ ]+/debian/?( |$)' | head -n 1 | tr -d ' ') || true
[ -n "$mirror" ] || { echo "prove: no Debian mirror among this machine's apt sources" >&2; exit 2; }
work=${TMPDIR:-/var/tmp}/flockstep-prove
mounts=()
root=

unmount() { # never delete through a mount
  for place in "${mounts[@]}"; do umount "$place" 2>/dev/null || umount -l "$place" 2>/dev/null || true; done
  mounts=()
  [ -z "$root" ] || rm -rf --one-file-system "$root"
  root=
}
trap unmount EXIT

mounted() { # TYPE SOURCE PLACE
  mkdir -p "$root$3"
  if [ "$1" = bind ]; then mount --bind "$2" "$root$3" && mount --make-private "$root$3"; else mount -t "$1" "$2" "$root$3"; fi
  mounts=("$root$3" "${mounts[@]}")
}

make_system() { # SUITE
  base=$work/$1
  if [ ! -e "$base.done" ]; then
    rm -rf "$base"
    mkdir -p "$work"
    debootstrap --variant=minbase --include=python3,python3-venv "$1" "$base" "$mirror" >"$base.log" 2>&1 ||
      { tail -n 5 "$base.log" >&2; exit 1; }
    touch "$base.done"
  fi
  root=$(mktemp -d "$work/run.XXXXXX")
  rm -r "$root"
  cp -a "$base" "$root"
  mounted proc proc /proc
  mounted bind /dev /dev
  mounted tmpfs tmpfs /dev/shm
  for file in /etc/resolv.conf /etc/hosts /etc/pip.conf /etc/ssl/certs/ca-certificates.crt; do
    [ ! -e "$file" ] || { mkdir -p "$root$(dirname "$file")"; cp -L "$file" "$root$file"; }
  done
  cp -a /etc/apt/apt.conf.d/. "$root/etc/apt/apt.conf.d/" 2>/dev/null || true
  for folder in ${PIP_FIND_LINKS:-}; do [ ! -d "$folder" ] || mounted bind "$folder" "$folder"; done
  chroot "$root" useradd --create-home pilot
}

kept=(LANG=C.UTF-8 PATH=/usr/local/bin:/usr/bin:/bin)
while IFS= read -r variable; do kept+=("$variable"); done < <(env |
  grep -E '^(PIP_|https?_proxy=|HTTPS?_PROXY=|no_proxy=|NO_PROXY=|SSL_CERT_FILE=|REQUESTS_CA_BUNDLE=|CURL_CA_BUNDLE=)' || true)

as_pilot() { # COMMAND: in the pilot's home, with nothing of this machine's environment
  echo "\$ $1"
  started=$SECONDS
  chroot "$root" setpriv --reuid=pilot --regid=pilot --init-groups --no-new-privs \
    env -i "${kept[@]}" HOME=/home/pilot USER=pilot sh -c "cd && $1"
  echo "  ($((SECONDS - started)) s)"
}

find_wheel() { # SUITE
  case $1 in bookworm) version=3.11 ;; trixie) version=3.13 ;; esac # of its python3
  tag=cp${version/./}
  wheel=$(find out/wheel -name "flockstep-*-$tag-$tag-*.whl" 2>/dev/null | sort | tail -n 1)
  [ -f "$wheel" ] || {
    echo "prove: no wheel for Python $version of $1 in out/wheel (./dev wheel makes it, where python$version is in PATH)" >&2
    exit 1
  }
}

prove() { # SUITE
  echo "== Debian $1, with python3 and python3-venv"
  find_wheel "$1"
  make_system "$1"
  home=$root/home/pilot
  cp "$wheel" constraints.txt packaging/first_flights.py "$home"
  # The README's block that trains.
  awk '/^```python$/ { inside = 1; block = ""; next } /^```$/ && inside { inside = 0; if (block ~ /\.learn\(/) { printf "%s", block; exit } } inside { block = block $0 "\n" }' README.md >"$home/first.py"
  chown -R --reference="$home" "$home"/*

  # The three commands.
  first=$SECONDS
  as_pilot "python3 -m venv flying"
  as_pilot "flying/bin/pip install -q --no-cache-dir -c constraints.txt './$(basename "$wheel")[film]'"
  installed=$SECONDS
  as_pilot "flying/bin/python first.py"
  echo "  from nothing to a trained policy: $((SECONDS - first)) s, of which pip took $((installed - first)) s"

  as_pilot "flying/bin/pip install -q --no-cache-dir -c constraints.txt './$(basename "$wheel")[sb3]'"
  as_pilot "flying/bin/python -m flockstep doctor"
  as_pilot "flying/bin/python first_flights.py without-opengl"
  chroot "$root" env DEBIAN_FRONTEND=noninteractive sh -c \
    'apt-get update -qq && apt-get install -y -qq --no-install-recommends libegl1 libgl1' >"$work/apt.log" 2>&1 ||
    { tail -n 5 "$work/apt.log" >&2; exit 1; }
  as_pilot "flying/bin/python first_flights.py with-opengl"
  unmount
}

for suite in "$@"; do find_wheel "$suite"; done # what is missing is told before a system is made
for suite in "$@"; do prove "$suite"; done
echo "proved: $*"
