"""Make .venv ready: Python packages at pinned versions, the compiled messages, the packages of src/.

Run it by `make setup` as often as you like: it does what is left to do, mostly nothing. It needs only Python.
$MABIRDS_CACHE (by default mabirds/wheels in the user's cache) keeps compiled messages for the next checkout.

Exit codes: 0 .venv is ready; 2 wrong arguments; 3 this machine lacks something (all of it is named, with the
command that mends it); 4 a step failed (named, with the end of its log); 130 interrupted (run it again).
"""

from __future__ import annotations

import ast
import contextlib
import fcntl
import functools
import hashlib
import importlib.util
import os
import platform
import re
import shutil
import signal
import subprocess
import sys
import sysconfig
import tempfile
import time
import zipfile
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NoReturn

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
VENV_PYTHON = VENV / "bin" / "python"
LOG = VENV / "setup.log"
STAMP = VENV / "setup.stamp"  # the key of what is set up; written last
SOUND = VENV / "setup.sound"  # the place that .venv was made for; away while a command changes .venv
CONSTRAINTS = ROOT / "constraints.txt"
MESSAGE_SOURCES = ("constraints.txt", "ros_ws/src/mabirds_msgs/**/*")
KERNEL_SOURCES = ("src/mabirds_core/mabirds_core/kernels/*.[ch]",)
PACKAGE_SOURCES = ("VERSION", "src/*/setup.*", "src/*/pyproject.toml", "src/*/package.xml", *KERNEL_SOURCES)
SOURCES = (*MESSAGE_SOURCES, *PACKAGE_SOURCES, "requirements.txt", "tools/setup_*.py")
PACKAGES = ("mabirds_core", "mabirds_msgs_py", "mabirds_expert_player", "mabirds_learner", "mabirds_bringup")
USER_CACHE = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
WHEEL_CACHE = Path(os.environ.get("MABIRDS_CACHE") or USER_CACHE / "mabirds" / "wheels").absolute()
GIGABYTES_NEEDED = 2
LOOK, NEWS = 0.5, 10.0  # seconds between two looks at a command, and between two lines where there is no terminal
TOLD = 0.1  # share of a step that must be done before its pace is believed
USUAL = {1: 1.0, 2: 8.0, 3: 140.0, 4: 60.0, 5: 15.0}  # seconds of each step, on two cores where nothing is there yet
EXIT_MISSING, EXIT_FAILED, EXIT_INTERRUPTED = 3, 4, 130
MACHINE = (str(sys.implementation.cache_tag), sysconfig.get_platform(), *platform.libc_ver())
PLACE = f"{VENV} {sys.base_prefix} {MACHINE}"  # what .venv is made for

BEGUN: dict[int, float] = {}  # when each step began, by the steady clock; the last is the present one

# Where packages come from is the user's to say, and whether all of them are compiled beforehand, which is half of the
# work; other settings of pip (user, target, no-deps ...) do harm.
PIP_SETTING_KEPT = re.compile(
    r"[^=]*\.((?:extra-)?index-url|find-links|no-index|trusted-host|(?:client-)?cert|proxy|"
    r"(?:default-)?timeout|retries|(?:no-)?cache-dir|keyring-provider|no-compile)=(.*)"
)
# Left by another ROS installation or virtual environment, these would mix it into the build.
DROPPED = r"PIP_.*|PYTHON(PATH|HOME)|(AMENT|CMAKE)_PREFIX_PATH|_ROS_WHEELS_BOOTSTRAP_COMPLETE"


def fail(exit_code: int, words: str) -> NoReturn:
    """End with the reason, in words for the user."""
    print(f"\n{words}", file=sys.stderr)
    raise SystemExit(exit_code)


def digest(patterns: tuple[str, ...], *facts: str) -> str:
    """SHA-256 of names and contents of the files that match, and of the facts."""
    total = hashlib.sha256("\0".join(facts).encode())
    for file in sorted(file for pattern in patterns for file in ROOT.glob(pattern) if file.is_file()):
        contents = hashlib.sha256(file.read_bytes()).hexdigest()
        total.update(f"\0{file.relative_to(ROOT)}\0{contents}".encode())
    return total.hexdigest()


def is_ready() -> bool:
    """Tell whether an earlier run got to its end and nothing has changed since."""
    return VENV_PYTHON.exists() and STAMP.exists() and STAMP.read_text() == digest(SOURCES, PLACE)


def missing_packages() -> Iterator[tuple[str, str]]:
    """What is missing to compile and install: the Debian package that mends it, and words for it."""
    python = f"python{sys.version_info.major}.{sys.version_info.minor}"
    for tool, words in (("gcc", "C compiler"), ("g++", "C++ compiler"), ("make", "program")):
        if shutil.which(tool) is None:
            yield tool, f"the {words} {tool}"
    if not Path(sysconfig.get_path("include"), "Python.h").exists():
        yield f"{python}-dev", f"Python.h, the C headers of {python}"
    if not all(importlib.util.find_spec(module) for module in ("venv", "ensurepip")):
        yield f"{python}-venv", f"the modules venv and ensurepip of {python}"


def other_problems() -> Iterator[str]:
    """What is missing and comes in no Debian package."""
    if sysconfig.get_platform() != "linux-x86_64" or platform.libc_ver()[0] != "glibc":
        yield "Linux on x86-64 with glibc: ROS wheels exist for nothing else (docker/README.md may help)"
    for folder in (ROOT, Path(tempfile.gettempdir()), WHEEL_CACHE):
        existing = next(place for place in (folder, *folder.parents) if place.exists())
        if shutil.disk_usage(existing).free < GIGABYTES_NEEDED * 1e9:
            yield f"{GIGABYTES_NEEDED} GB of free disk space for {folder}"
    for name in PACKAGES:
        if not (ROOT / "src" / name / "pyproject.toml").exists():
            yield f"src/{name}/pyproject.toml: the checkout is incomplete (see `git status`)"


def check_prerequisites() -> None:
    """Say everything that is missing at once."""
    packages, problems = dict(missing_packages()), list(other_problems())
    if platform.python_implementation() != "CPython" or not (3, 11) <= sys.version_info[:2] <= (3, 13):
        packages = {name: words for name, words in packages.items() if not name.startswith("python")}
        problems.insert(0, f"CPython 3.11 to 3.13 (PYTHON=... names one), not {sys.version.split()[0]}")
    lines = ["missing on this machine:", *(f"  - {words}" for words in [*problems, *packages.values()])]
    if packages:
        lines.append(f"On Debian and Ubuntu: sudo apt-get install {' '.join(packages)}")
    if len(lines) > 1:
        fail(EXIT_MISSING, "\n".join(lines))


@functools.lru_cache
def pip_environment() -> dict[str, str]:
    """Environment variables of all commands in .venv: the user's, less what could lead them astray."""
    listing, shell = (VENV_PYTHON, "-m", "pip", "config", "list"), {**os.environ, "PIP_QUIET": "0"}
    output = subprocess.run(listing, env=shell, capture_output=True, text=True, check=False).stdout
    kept = {name: value for name, value in os.environ.items() if not re.fullmatch(DROPPED, name)}
    for line in sorted(output.splitlines(), key=lambda line: ":env:" in line):  # variables win over files
        if setting := PIP_SETTING_KEPT.fullmatch(line):
            name, value = setting.groups()
            kept[f"PIP_{name.upper()}".replace("-", "_")] = " ".join(ast.literal_eval(value).split())
    return {**kept, "PIP_CONFIG_FILE": os.devnull}  # reads no file: all that counts is here


def run(*command: str | Path, remedy: str, changes_venv: bool = True) -> None:
    """Run a command, its output in the log; it holds the lock as long as it lives."""
    if changes_venv:
        SOUND.unlink(missing_ok=True)
    env = pip_environment() if VENV_PYTHON.exists() else None
    with LOG.open("a") as log:
        print("$", *command, file=log, flush=True)
        begun = log.tell()
        with subprocess.Popen(command, cwd=ROOT, env=env, stdout=log, stderr=log, close_fds=False) as process:
            show_progress(process, begun)
        code = process.returncode
    if code >= 0:  # else it was killed and may have left .venv half changed
        SOUND.write_text(PLACE)
    if code != 0:
        tail = "\n".join(LOG.read_text(errors="replace").splitlines()[-30:])
        fail(EXIT_FAILED, f"{tail}\n\nexit code {code}; the whole output is in {LOG}\n{remedy}")


def show_progress(process: subprocess.Popen[bytes], begun: int) -> None:
    """Until a command ends, what its log says it is at: in place on a terminal, else a line every NEWS seconds."""
    told, before, seen = time.monotonic(), installed_count(), list[tuple[float, float]]()
    while True:
        try:
            process.wait(LOOK)
        except subprocess.TimeoutExpired:
            now, (words, share) = time.monotonic(), newest_words(begun, before)
            seen += [(now, share)] if share is not None else []
            if sys.stdout.isatty() or now - told > NEWS:
                told = now
                tell(f"{progress_words(now, seen)}: {words}")
            continue
        except KeyboardInterrupt:
            process.terminate()
            raise
        if sys.stdout.isatty():
            print("\x1b7\x1b[K\x1b8", end="", flush=True)  # what stood behind the announced step
        return


def tell(words: str) -> None:
    """Words behind the step: on a terminal over what stood there, from where they leave the cursor as it was."""
    if sys.stdout.isatty():
        room = max(12, shutil.get_terminal_size().columns - 42)  # for the longest step's words stand before
        print(f"\x1b7\x1b[K{words[:room]}\x1b8", end="", flush=True)
    else:
        print(f"\n      {words[:72]}", end=" ", flush=True)


def progress_words(now: float, seen: Sequence[tuple[float, float]] = ()) -> str:
    """How long the present step has taken, and what is left of all, as an estimate.

    By the pace of what was ``seen`` (pairs of time and share that is done), else by how long steps usually take.
    """
    number, begun = list(BEGUN.items())[-1]
    left = USUAL[number] - (now - begun)
    if seen and seen[-1][1] - seen[0][1] >= TOLD:
        (first, share), (last, done) = seen[0], seen[-1]
        left = (1 - done) * (last - first) / (done - share)
    later = sum(seconds for other, seconds in USUAL.items() if other > number)
    words = f"about {round_seconds(left + later)} left" if left >= 0 else "longer than usual"
    return f"{now - begun:.0f} s, {words}"


def round_seconds(seconds: float) -> str:
    """An estimate in words, no finer than ten seconds."""
    tens = max(10, 10 * round(seconds / 10))
    return f"{tens} s" if tens < 100 else f"{round(seconds / 60)} min"


def installed_count() -> int:
    """How many packages .venv has."""
    return len(list(VENV.glob("lib/python*/site-packages/*.dist-info")))


def newest_words(begun: int, before: int = 0) -> tuple[str, float | None]:
    """The last thing that pip or a compiler said, and which share of a step is done, where they say it.

    ``before``: packages that were there when the command began.
    """
    with LOG.open("rb") as log:
        log.seek(begun)
        lines = [line.strip() for line in log.read().decode(errors="replace").split("\n")]
    said = [line for line in lines if re.match(r"(Collecting|Downloading|Building|Installing|\[\d+/)", line)]
    last, collected = said[-1] if said else "at work", sum(line.startswith("Collecting") for line in lines)
    if last.startswith("Installing collected packages:") and (done := installed_count() - before) > 0:
        total = last.count(",") + 1
        return f"{done} of {total} packages installed", min(1.0, done / total)
    if built := re.match(r"\[(\d+)/(\d+)\]", last):
        return last, int(built[1]) / max(1, int(built[2]))
    return f"{collected} packages, {last}" if said and collected else last, None


def pip(*arguments: str | Path, remedy: str) -> None:
    """Run the pip of .venv."""
    command = (VENV_PYTHON, "-m", "pip", "--disable-pip-version-check", "--no-input", *arguments)
    run(*command, remedy=remedy, changes_venv=arguments[0] == "install")


def make_venv() -> None:
    """Make .venv, unless there is a sound one for this place and this Python."""
    if not (Path(VENV, "bin", "pip").exists() and SOUND.exists() and SOUND.read_text() == PLACE):
        SOUND.unlink(missing_ok=True)
        shutil.rmtree(VENV, ignore_errors=True)
        VENV.mkdir()
        python = getattr(sys, "_base_executable", sys.executable)  # for this one may have been in .venv
        run(python, "-m", "venv", VENV, remedy="Is this Python whole? Choose another: make setup PYTHON=...")
    STAMP.unlink(missing_ok=True)
    LOG.write_text("")


def install_requirements() -> None:
    """Install pip and what requirements.txt names, at the versions of constraints.txt."""
    remedy = "Often it is the network or pip's index settings (pip config list). Then run make setup again."
    pip("install", "--constraint", CONSTRAINTS, "--upgrade", "pip", remedy=remedy)
    pip("install", "--constraint", CONSTRAINTS, "--requirement", ROOT / "requirements.txt", remedy=remedy)


def build_messages(folder: Path) -> Path:
    """Compile the messages; the wheel enters the cache in one move, whoever else is building it."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        options = ("--verbose", "--no-deps", "--build-constraint", CONSTRAINTS, "--wheel-dir", scratch)
        pip("wheel", *options, ROOT / "ros_ws/src/mabirds_msgs", remedy="Mend the log's first error.")
        (built,) = Path(scratch).glob("*.whl")
        return built.replace(folder / built.name)


def install_messages() -> None:
    """Install the compiled messages, from the cache if it has them."""
    folder = WHEEL_CACHE / digest(MESSAGE_SOURCES, *MACHINE)
    cached = next((wheel for wheel in folder.glob("*.whl") if zipfile.is_zipfile(wheel)), None)
    with step(4, "installing mabirds_msgs" if cached else "building mabirds_msgs"):
        wheel = cached or build_messages(folder)
        remedy = f"Is the wheel broken? Then delete {wheel} and run make clean setup."
        pip("install", "--no-deps", "--force-reinstall", wheel, remedy=remedy)
        run(VENV_PYTHON, "-c", "import rclpy, mabirds_msgs.msg, mabirds_msgs.srv", remedy=remedy)


def install_packages() -> None:
    """Install the packages of src/ so that edits count at once."""
    editable = [argument for name in PACKAGES for argument in ("--editable", ROOT / "src" / name)]
    remedy = "The package's pyproject.toml, setup.cfg or package.xml wants mending."
    pip("install", "--no-deps", "--no-build-isolation", *editable, remedy=remedy)


@contextlib.contextmanager
def step(number: int, words: str) -> Iterator[None]:
    """Announce a step, and say how long it took."""
    started = BEGUN[number] = time.monotonic()
    print(f"[{number}/5] {words} ... ", end="", flush=True)
    yield
    print(f"{time.monotonic() - started:.1f} s", flush=True)


def set_up() -> None:
    """Do what is left to do, one step after another."""
    key = digest(SOURCES, PLACE)
    print(f"this takes about {round_seconds(sum(USUAL.values()))} where nothing is there yet, else less", flush=True)
    with step(1, "checking this machine"):
        check_prerequisites()
    with step(2, "making .venv"):
        make_venv()
    with step(3, "installing Python packages"):
        install_requirements()
    install_messages()
    with step(5, "installing the packages of src/"):
        install_packages()
    STAMP.write_text(key)


def lock_checkout() -> None:
    """Let one set-up at a time work here; the lock ends with this process and the commands it started."""
    folder = os.open(ROOT, os.O_RDONLY)
    os.set_inheritable(folder, True)
    try:
        fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        print("waiting for another set-up of this checkout", flush=True)
        fcntl.flock(folder, fcntl.LOCK_EX)


def main() -> None:
    """Set up, if there is anything to do."""
    ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter).parse_args()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        if not is_ready():
            lock_checkout()
        if not is_ready():
            set_up()
    except KeyboardInterrupt:
        fail(EXIT_INTERRUPTED, "interrupted; make setup goes on from here")
    except OSError as error:
        fail(EXIT_FAILED, f"{error}\nIs there a disk full, or a folder that cannot be written?")


if __name__ == "__main__":
    main()
