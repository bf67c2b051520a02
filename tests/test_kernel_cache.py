"""Compiled kernels on the disk: a disk that fails costs time, never a run."""

from __future__ import annotations

import errno
import multiprocessing
import pickle
from pathlib import Path

import numba
import pytest
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.dispatcher import Dispatcher

from mammosim import _jit, _kernel_cache
from mammosim.compression.hyperelastic import _tangent_kernels

PACKAGE = Path(_jit.__file__).parent

pytestmark = pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")


@pytest.fixture
def reasons(monkeypatch):
    """Why kernels were not saved, from here on."""
    found: list[str] = []
    monkeypatch.setattr(_kernel_cache._ReadOnlyPlace, "in_use", False)
    monkeypatch.setattr(_kernel_cache, "_problems", found)
    return found


def doubling():
    """A kernel that no other test has compiled, kept under this file's name."""

    def twice(number):
        return 2 * number

    return _jit.kernel(twice)


def test_a_kernel_can_be_sent_to_another_process(monkeypatch):
    kernel = doubling()
    sent = pickle.dumps(kernel)
    monkeypatch.setattr(Dispatcher, "_memo", {})  # as there, where nobody knows it
    received = pickle.loads(sent)
    assert received is not kernel
    assert received.targetoptions == kernel.targetoptions
    assert received(3) == 6


@pytest.mark.parametrize("part", ["_save_overload", "_load_overload"])
def test_a_disk_that_fails_costs_no_run(part, reasons, monkeypatch):
    def full(*arguments):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(FunctionCache, "_load_overload", lambda *arguments: None)
    monkeypatch.setattr(FunctionCache, part, full)
    assert doubling()(3) == 6
    assert "No space left on device" in _kernel_cache.cache_problem()


def test_nowhere_to_keep_kernels_costs_no_run(reasons, monkeypatch):
    def nowhere(self, function):
        raise RuntimeError("cannot cache function: no locator available")

    monkeypatch.setattr(FunctionCache, "__init__", nowhere)
    assert doubling()(3) == 6
    assert (
        "neither the program's folder nor the home folder can be written"
        in _kernel_cache.cache_problem()
    )


@pytest.mark.parametrize("content", [b"", b"\x80\x05garbage", b"\x80\x04N."])
def test_a_damaged_file_is_made_again(content, reasons):
    first = doubling()
    assert first(3) == 6
    index = Path(first._cache._cache_file._index_path)
    index.write_bytes(content)
    assert doubling()(3) == 6
    again = doubling()
    assert again(3) == 6
    assert sum(again.stats.cache_hits.values()) == 1, "the index was not made again"
    assert _kernel_cache.cache_problem() == ""
    assert isinstance(again._cache._cache_file, IndexDataCacheFile)


def test_what_a_kernel_calls_in_other_files_counts(tmp_path):
    """Its compiled code holds theirs: an old one must not be used after an update."""
    outer = tmp_path / "room" / "_outer_kernels.py"
    inner, deep = tmp_path / "room" / "_inner_kernels.py", tmp_path / "_deep_kernels.py"
    other = tmp_path / "room" / "_other_kernels.py"
    outer.parent.mkdir()
    files = {
        outer: "from mammosim.room._inner_kernels import (\n    step,\n)\n",
        inner: "from mammosim._deep_kernels import deepest\nimport numpy\n",
        deep: "deepest = 1\n",
        other: "",
    }

    def stamp_with(changed: Path | None, text: str = "# changed\n") -> str:
        for file, content in files.items():
            file.write_text(content + (text if file == changed else ""))
        _kernel_cache._text.cache_clear()
        return _kernel_cache.source_stamp.__wrapped__(outer, tmp_path)

    before = stamp_with(None)
    assert stamp_with(outer) != before
    assert stamp_with(inner) != before
    assert stamp_with(deep) != before
    assert stamp_with(other) == before, "nothing imports it"
    files[deep] = "@chosen_by_type\ndef deepest(kind): ...\n"
    member = tmp_path / "_member_kernels.py"
    files[member] = "@deepest.of(Kind)\ndef formula(kind): ...\n"
    family = stamp_with(None)
    assert stamp_with(member) != family, "a kernel may hold the formula of any member"


def test_every_kernel_is_stamped_with_what_it_calls():
    stamped = _kernel_cache._sources(Path(_tangent_kernels.__file__), PACKAGE)
    names = {str(file.relative_to(PACKAGE)) for file in stamped}
    laws = "compression/hyperelastic/laws"
    assert {"_jit.py", f"{laws}/_law_kernels.py", f"{laws}/_neo_hookean_kernels.py"} <= names
    # What runs, stops and keeps kernels is part of them; nothing else but kernels is.
    around = {"_jit.py", "_crew.py", "_interruption.py", "_kernel_cache.py"}
    assert all(name.endswith("_kernels.py") for name in names - around)


def test_kernels_of_an_image_are_read_where_nothing_can_be_written(reasons, monkeypatch, tmp_path):
    """As in a container whose files are read-only, started by a user without a home."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    assert doubling()(3) == 6
    assert _kernel_cache.can_be_kept()
    (kept,) = tmp_path.iterdir()
    monkeypatch.setattr(_kernel_cache, "_read_only_folders", lambda source: [str(kept)])
    monkeypatch.setattr(_kernel_cache._Places, "_locator_classes", [_kernel_cache._ReadOnlyPlace])
    again = doubling()
    assert again(3) == 6
    assert sum(again.stats.cache_hits.values()) == 1
    assert _kernel_cache.cache_problem() == ""
    assert not _kernel_cache.can_be_kept(), "nothing to compile ahead for"


def test_kernels_of_an_image_are_read_beside_ones_own(reasons, monkeypatch, tmp_path):
    image, own = tmp_path / "image", tmp_path / "own"
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(image))
    assert doubling()(3) == 6
    (kept,) = image.iterdir()
    monkeypatch.setattr(_kernel_cache, "_read_only_folders", lambda source: [str(kept)])
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(own))
    again = doubling()
    assert again(3) == 6
    assert sum(again.stats.cache_hits.values()) == 1
    assert again(1.5) == 3.0
    assert [path.suffix for path in own.rglob("*.nb[ci]")].count(".nbc") == 1, "the new variant"


def test_variants_saved_by_several_processes_keep_their_names(tmp_path):
    """Each reads the index and adds to it: two at once must not give two variants one name."""
    saving = [
        multiprocessing.get_context("fork").Process(target=_save_variants, args=(tmp_path, first))
        for first in range(2)
    ]
    for process in saving:
        process.start()
    for process in saving:
        process.join(20)
    file = _kernel_cache._CacheFile(str(tmp_path), "kernel", "stamp")
    assert [file.load(number) for number in range(40)] == [f"code {n}" for n in range(40)]


def _save_variants(folder: Path, first: int) -> None:
    file = _kernel_cache._CacheFile(str(folder), "kernel", "stamp")
    for number in range(first, 40, 2):
        file.save(number, f"code {number}")


def test_a_lock_that_another_holds_is_not_waited_for_without_end(tmp_path, monkeypatch):
    monkeypatch.setattr(_kernel_cache, "LOCK_S", 0.05)
    file = _kernel_cache._CacheFile(str(tmp_path), "kernel", "stamp")
    with _kernel_cache._locked(str(tmp_path)):
        file.save("key", "code")
    assert file.load("key") == "code"
