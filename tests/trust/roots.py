"""Does the quick start work where nothing is installed: in bare roots of Debian and Ubuntu, with their own Pythons?

    sudo python tests/trust/roots.py FOLDER trixie noble            `make demo`, a look at what it made, and some tests
    sudo python tests/trust/roots.py FOLDER resolute --whole        and all of `make test`

FOLDER keeps the bare roots that debootstrap makes; work is done in a copy, thrown away afterwards. Needs root, debootstrap,
some 4 GB of disk and the network; for Ubuntu also the keyring of its archive (--keyring FILE, where Debian's package
ubuntu-keyring is not installed). Exit status: 0 if all suites pass.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DEBIAN, UBUNTU = "http://deb.debian.org/debian", "http://archive.ubuntu.com/ubuntu"
SUITES = {"bookworm": DEBIAN, "trixie": DEBIAN, "sid": DEBIAN, "noble": UBUNTU, "resolute": UBUNTU}
KEYRING = "/usr/share/keyrings/ubuntu-archive-keyring.gpg"
ASSUMED = "git make"  # what README takes for granted, beside a shell; Python is installed by .ci/setup
LENT = {
    "/etc/resolv.conf": "etc/resolv.conf",
    "/etc/ssl/certs/ca-certificates.crt": "root/certificates",
}  # how one reaches the network here
TESTED = "tests/core tests/scene/test_gltf.py tests/image tests/trust/test_outputs.py tests/app/viewer/interface/test_window.py"
STEPS = f"""
set -e
export DEBIAN_FRONTEND=noninteractive HOME=/root LANG=C.UTF-8 CI=1 PATH=/usr/sbin:/usr/bin:/sbin:/bin
apt-get update -qq; apt-get install -y -qq --no-install-recommends {ASSUMED} >/dev/null
cd /root; git config --global --add safe.directory '*'
git clone -q /root/origin irrsplat; cd irrsplat
make demo >/dev/null
test "$(find out -name '*.png' | wc -l)" -ge 7
.venv/bin/irrsplat doctor
"""
SHORT = f"sh .ci/setup dev >/dev/null; .venv/bin/python -m pytest -q -n auto -m 'not slow and not long' {TESTED}"
WHOLE = "make test"


def bare(folder: Path, suite: str, keyring: str) -> Path:
    """The folder of a suite's bare root, made where it is not there yet."""
    root = folder / suite
    if not root.is_dir():
        part = folder / f"{suite}.part"
        shutil.rmtree(part, ignore_errors=True)
        command = ["debootstrap", "--variant=minbase", suite, str(part), SUITES[suite]]
        if SUITES[suite] == UBUNTU:
            command[1:1] = [f"--keyring={keyring}", "--components=main,universe"]
            command.append("gutsy")  # the script by which debootstrap makes every later Ubuntu
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        part.rename(root)
    return root


def tried(root: Path, whole: bool) -> int:
    """The exit status of the quick start in a copy of a bare root."""
    with tempfile.TemporaryDirectory(dir=root.parent) as folder:
        copy = Path(folder) / "root"
        subprocess.run(["cp", "-a", root, copy], check=True)
        subprocess.run(["git", "clone", "-q", ROOT, copy / "root/origin"], check=True)
        for file, name in LENT.items():
            (copy / name).unlink(missing_ok=True)
            shutil.copyfile(file, copy / name)
        lent = {name: value for name, value in os.environ.items() if name.startswith(("PIP_INDEX", "http", "HTTP"))}
        script = STEPS + (WHOLE if whole else SHORT)
        mounts = f"mount -t proc proc {copy}/proc; mount --rbind /dev {copy}/dev; mount --rbind /sys {copy}/sys"
        inside = ["unshare", "--mount", "sh", "-ec", f'{mounts}; exec chroot {copy} sh -c "$1"', "sh", script]
        environment = {"PATH": os.environ["PATH"], "PIP_CERT": "/root/certificates", **lent}
        return subprocess.run(inside, env=environment, check=False).returncode


def main() -> int:
    """Run the command line; the exit status."""
    assert __doc__ is not None
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("suites", nargs="+", choices=SUITES)
    parser.add_argument("--whole", action="store_true", help="run all of `make test`")
    parser.add_argument("--keyring", default=KEYRING, help="that Ubuntu signs its suites with")
    args = parser.parse_args()
    failed = []
    for suite in args.suites:
        args.folder.mkdir(parents=True, exist_ok=True)
        root, start = bare(args.folder.resolve(), suite, args.keyring), time.monotonic()
        status = tried(root, args.whole)
        print(
            f"{suite}: {'passed' if status == 0 else f'failed with status {status}'} after {time.monotonic() - start:.0f} s",
            flush=True,
        )
        failed += [suite] * (status != 0)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
