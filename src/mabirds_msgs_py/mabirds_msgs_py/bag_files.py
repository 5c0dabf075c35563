"""Which files make a bag, and how each is opened: rosbag2 directories, directories without metadata, single files.

What a file is, its first bytes say: MCAP, MCAP in zstd or lz4 (rosbag2's file compression), or something else that is
refused with its remedy.
"""

import io
import shutil
import tempfile
from pathlib import Path
from typing import IO, Any

import lz4.frame  # type: ignore[import-untyped]
import zstandard

from mabirds_core.texts import sanitize, truncate
from mabirds_core.yaml_files import read_yaml
from mabirds_msgs_py.errors import BagError
from mabirds_msgs_py.mcap_scan import MAGIC

ZSTD, LZ4 = b"\x28\xb5\x2f\xfd", b"\x04\x22\x4d\x18"
"""First bytes of a zstd and of an lz4 frame."""

SQLITE = b"SQLite format 3\0"
GIT_LFS = b"version https://git-lfs"

CONVERT = "convert the bag with `rosbags-convert --src BAG --dst NEW --dst-storage mcap` (pip install rosbags)"

COMPRESSED_SUFFIXES = ("", ".zstd", ".lz4")
"""What rosbag2 adds to the name of a file that it compresses, which old metadata do not say."""

PATTERNS = ("*.mcap", "*.mcap.zstd", "*.mcap.lz4")


def bag_files(bag: Path) -> list[Path]:
    """The MCAP files of a bag, in the order of its metadata, else of their names.

    Parameters
    ----------
    bag : Path
        A rosbag2 directory, a directory of MCAP files, or one file.

    Returns
    -------
    list[Path]
        They need not exist.

    Raises
    ------
    BagError
        There are none, or the metadata are none.
    """
    if not bag.is_dir():
        if not bag.exists():
            raise BagError(f"{bag}: is not there; give the directory of a rosbag2 bag, or an .mcap file")
        return [bag]
    metadata = bag / "metadata.yaml"
    if metadata.exists():
        return [_existing(bag / name) for name in _named_files(metadata)]
    if files := sorted(file for pattern in PATTERNS for file in bag.glob(pattern)):
        return files
    if others := sorted(bag.glob("*.db3*")):
        raise BagError(f"{others[0]}: storage 'sqlite3', expected 'mcap'; {CONVERT}")
    raise BagError(f"{bag}: has neither metadata.yaml nor .mcap files; give the directory of a rosbag2 bag")


def _existing(file: Path) -> Path:
    """The file, or where it does not exist and its compressed form does, that."""
    candidates = [file.with_name(file.name + suffix) for suffix in COMPRESSED_SUFFIXES]
    return next((candidate for candidate in candidates if candidate.exists()), file)


def _named_files(metadata: Path) -> list[str]:
    try:
        _refuse_git_lfs(metadata, _first_bytes(metadata))
        information = read_yaml(metadata)["rosbag2_bagfile_information"]
        storage, names = information["storage_identifier"], information["relative_file_paths"]
    except BagError:
        raise
    except OSError as error:
        raise BagError(f"{metadata}: cannot be read ({error.strerror}); give the directory of a rosbag2 bag") from None
    except (ValueError, TypeError, KeyError) as error:
        raise BagError(
            f"{metadata}: is not the metadata of a rosbag2 bag ({error}); remove it, and the files beside it are read"
        ) from None
    if storage != "mcap":
        raise BagError(f"{metadata}: storage {truncate(repr(storage))}, expected 'mcap'; {CONVERT}")
    if not _are_names(names):
        raise BagError(
            f"{metadata}: relative_file_paths {truncate(repr(names))}, expected different names of files beside it"
        )
    return names


def _are_names(names: Any) -> bool:
    """A list of different names of files, none of them elsewhere?"""
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        return False
    return len(set(names)) == len(names) and all(name == Path(name).name and "\0" not in name for name in names)


def open_mcap(file: Path) -> IO[bytes]:
    """Open an MCAP file; one that is compressed as a whole is decompressed into a temporary file first.

    Parameters
    ----------
    file : Path
        Of the bag.

    Returns
    -------
    IO[bytes]
        To be closed.

    Raises
    ------
    BagError
        It cannot be read, or is something else.
    """
    try:
        if file.exists() and not (file.is_file() or file.is_dir()):
            raise BagError(f"{file}: is no file but a pipe or device; name a bag of files")
        stream = io.BufferedReader(io.FileIO(file), buffer_size=2**17)
    except OSError as error:
        raise BagError(f"{file}: cannot be read ({error.strerror})") from None
    first = stream.peek(len(GIT_LFS))
    if first.startswith((ZSTD, LZ4)):
        with stream:
            return _decompressed(file, stream, first)
    try:
        _refuse_others(file, first)
    except BagError:
        stream.close()
        raise
    return stream


def _refuse_others(file: Path, first: bytes) -> None:
    _refuse_git_lfs(file, first)
    if first.startswith(SQLITE):
        raise BagError(f"{file}: storage 'sqlite3', expected 'mcap'; {CONVERT}")
    if first and not first.startswith(MAGIC[:4]):
        shown = sanitize(first[:8].decode("latin-1"))
        raise BagError(
            f"{file}: begins with '{shown}', not as an MCAP file does; intact up to no iteration of any topic;"
            " fetch it again or record it anew"
        )


def _refuse_git_lfs(file: Path, first: bytes) -> None:
    if first.startswith(GIT_LFS):
        raise BagError(f"{file}: is a pointer of Git LFS, its content was not fetched; run `git lfs pull` beside it")


def _first_bytes(file: Path) -> bytes:
    with file.open("rb") as stream:
        return stream.read(len(GIT_LFS))


def _decompressed(file: Path, stream: IO[bytes], first: bytes) -> IO[bytes]:
    """The content in a temporary file, which goes when it is closed."""
    zstd = first.startswith(ZSTD)
    target = tempfile.TemporaryFile()  # noqa: SIM115 - the caller closes it
    try:
        source: Any = (
            zstandard.ZstdDecompressor(max_window_size=2**27).stream_reader(stream, read_across_frames=True)
            if zstd
            else lz4.frame.LZ4FrameFile(stream)
        )
        shutil.copyfileobj(source, target, 2**20)
    except (zstandard.ZstdError, RuntimeError, EOFError, ValueError, OSError) as error:
        target.close()
        kind = "zstd" if zstd else "lz4"
        raise BagError(
            f"{file}: its {kind} compression cannot be undone in {tempfile.gettempdir()} ({error});"
            " the file is damaged or the disk is full: fetch it again, or set TMPDIR to a larger disk"
        ) from None
    target.seek(0)
    return target
