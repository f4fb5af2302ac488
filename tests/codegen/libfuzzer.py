"""Fuzz a controller package with libFuzzer: ``python -m tests.codegen.libfuzzer --seconds 60``."""

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from dualwinch.codegen.export.package import c_package
from dualwinch.simulation.blocks import block
from dualwinch.simulation.paper import case
from tests.codegen.export.test_package import ABOUT

SANITIZERS = ("-fsanitize=fuzzer,address,undefined", "-fno-sanitize-recover=all")


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.codegen.libfuzzer", description=__doc__)
    parser.add_argument("--seconds", type=int, default=60, help="how long (default: 60)")
    seconds = parser.parse_args().seconds
    clang = shutil.which("clang")
    if clang is None:
        sys.stderr.write("no clang, no libFuzzer: nothing done\n")
        return 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file, text in c_package(block("controller", case(4)), "controller", ABOUT).items():
            (folder / file).write_text(text)
        source = str(Path(__file__).with_name("fuzz.c"))
        flags = ["-g", "-O1", "-DLIBFUZZER", *SANITIZERS, "-I.", source, "controller.c", "-lm", "-o", "fuzz"]
        if subprocess.run([clang, *flags], cwd=folder, check=False).returncode:
            sys.stderr.write("this clang has no libFuzzer: nothing done\n")
            return 0
        run = ["./fuzz", f"-max_total_time={seconds}", "-verbosity=0", "-print_final_stats=1"]
        return subprocess.run(run, cwd=folder, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
