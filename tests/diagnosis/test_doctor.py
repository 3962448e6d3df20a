"""`deepring doctor`: what it says of the machine, what it finds wrong, and what it keeps back."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

from deepring.diagnosis import diagnosis as whole
from deepring.diagnosis import folders, machine, packages
from deepring.diagnosis.diagnosis_text import as_text, as_values, without_names
from deepring.diagnosis.folders import Folder
from deepring.diagnosis.machine import Gpu, Memory, Processor, Threads
from deepring.diagnosis.packages import Package, Packages
from deepring.diagnosis.timings import SLOW, STATED, Timing, time_text
from deepring.errors import FileError
from helpers.cli import deepring
from helpers.schemas import of_schema

DOCS = Path(__file__).parents[2] / "docs" / "troubleshooting.md"

PROCESSOR = Processor("a processor", "AVX2", cores=8, allowed=8, quota=None, load=0.5)


@pytest.fixture(scope="module")
def printed(tmp_path_factory):
    """What the command says where everything works, as JSON."""
    done = deepring("doctor", "--as", "json", cwd=tmp_path_factory.mktemp("doctor"))
    return done, of_schema("diagnosis", done.stdout)


def silent(done, total):
    """A progress that nobody sees."""


def subjects(troubles):
    return [(trouble.subject, trouble.fails) for trouble in troubles]


def test_where_all_is_there_nothing_fails(printed):
    done, content = printed
    assert done.returncode == 0, content["troubles"]
    assert content["works"]
    assert all(line.startswith("measuring steps: ") for line in done.stderr.splitlines())
    assert [one["step"] for one in content["timings"]] == list(STATED)
    assert all(one["milliseconds"] > 0 for one in content["timings"])
    versions = {one["name"]: one["version"] for one in content["packages"]}
    assert versions["torch"].partition(".")[0].isdigit()
    assert {one["what"] for one in content["folders"]} == set(folders._ADVICE)
    assert "dev" not in content["extras"]


@pytest.fixture
def quick(monkeypatch):
    """A diagnosis without measurements."""
    monkeypatch.setattr(whole, "measure", lambda _: [])
    return lambda cache: whole.diagnose(cache, silent)


def test_the_text_fits_80_columns_and_tells_no_names(quick, tmp_path, monkeypatch):
    monkeypatch.setattr(Path, "home", lambda: tmp_path)
    text = as_text(quick(tmp_path / "cache"), without_names)
    paths = [word for word in text.split() if "/" in word]
    assert all(len(line) <= 80 or line.strip() in paths for line in text.splitlines())
    assert str(tmp_path) not in text
    assert "~/cache: not there yet, can be written" in re.sub(r"\s+", " ", text)


def test_in_full_paths_are_whole(quick, tmp_path, monkeypatch):
    monkeypatch.setattr(Path, "home", lambda: tmp_path)
    paths = [one["path"] for one in as_values(quick(tmp_path / "cache"), str)["folders"]]
    assert str(tmp_path / "cache") in paths


def test_names_of_other_homes_and_of_the_user_are_hidden(monkeypatch):
    monkeypatch.setenv("LOGNAME", "meyer")
    monkeypatch.setattr(Path, "home", lambda: Path("/home/meyer"))
    hidden = without_names("/home/meyer/a /home/smith/b /Users/jones/c /data/meyer/d /data/meyers")
    assert hidden == "~/a /home/USER/b /Users/USER/c /data/USER/d /data/meyers"
    assert without_names("/home/smith: free; /mnt/home/disk") == "/home/USER: free; /mnt/home/disk"


def test_a_command_without_a_folder_to_write_to_fails(tmp_path):
    (tmp_path / "file").write_text("")
    done = deepring("doctor", "--cache", "file/cache", cwd=tmp_path)
    assert done.returncode == 1
    said = re.sub(r"\s+", " ", done.stdout)
    assert "commands fail by: - folders: cache: nothing can be written in" in said
    assert "paths.cache=FOLDER" in said


def test_a_damaged_network_is_why_commands_fail(tmp_path, monkeypatch):
    def broken(progress):
        raise FileError("deepring.safetensors: damaged")

    monkeypatch.setattr(whole, "measure", broken)
    diagnosis = whole.diagnose(tmp_path, silent)
    assert not diagnosis.works
    assert subjects(diagnosis.troubles)[0] == ("network", True)
    assert "damaged" in diagnosis.troubles[0].found


@pytest.mark.parametrize(
    ("error", "found"),
    [
        (ImportError("no", name="numba"), "numba cannot be imported (ImportError)"),
        (RuntimeError("cannot cache function"), "a step of the commands fails with RuntimeError"),
    ],
)
def test_whatever_breaks_a_step_is_told(tmp_path, monkeypatch, error, found):
    def broken(progress):
        raise error

    monkeypatch.setattr(whole, "measure", broken)
    trouble = whole.diagnose(tmp_path, silent).troubles[0]
    assert (trouble.found, trouble.fails) == (found, True)


def test_a_required_package_that_is_missing_or_too_old_makes_commands_fail():
    good = Package("torch", ">=2.4", "2.6", fits=True)
    bad = [Package("numpy", ">=1.26", "1.2", fits=False), Package("scipy", ">=1", None, fits=False)]
    found = list(Packages(True, [good, *bad], {"bags": [bad[1]]}).troubles())
    assert subjects(found) == [("packages", True)] * 2
    assert "numpy is 1.2, expected numpy>=1.26; run pip install 'numpy>=1.26'" in str(found[0])
    assert "scipy is missing" in str(found[1])


def test_an_extra_is_a_doubt_only_where_its_package_is_there_and_does_not_fit():
    old = Package("kiss-icp", ">=1.3", "1.2", fits=False)
    absent = Package("gtsam", ">=4.3", None, fits=False)
    found = Packages(True, [], {"odometry": [old], "optimize": [absent]}).troubles()
    assert subjects(found) == [("packages", False)]


def test_what_is_installed_is_what_the_metadata_ask_for():
    found = packages.find_packages()
    assert found.known
    assert {"torch", "numpy", "hydra-core"} <= {one.name for one in found.required}
    assert all(one.fits for one in found.required)
    assert "rosbags" in {one.name for one in found.extras["bags"]}
    assert "rosbags" not in {one.name for one in found.required}


def test_threads_are_compared_with_the_cores_that_may_be_used():
    assert not list(PROCESSOR.troubles())
    held = replace(PROCESSOR, allowed=4, quota=2.5, load=20.0, vectors="SSE")
    assert held.usable == 2
    assert [trouble.subject for trouble in held.troubles()] == ["processor"] * 4
    few = list(Threads(1, 1, {"OMP_NUM_THREADS": "1"}).troubles(2))
    assert "torch uses 1 of 2 cores (OMP_NUM_THREADS=1)" in few[0].found
    assert "8 threads on 2 cores" in next(Threads(8, 8, {}).troubles(2)).found
    assert not list(Threads(2, 2, {}).troubles(2))


def test_little_memory_and_an_unused_gpu_are_doubts():
    assert subjects(Memory(8 << 30, 1 << 30, 64 << 20).troubles()) == [("memory", False)] * 2
    assert not list(Memory(None, None, None).troubles())
    assert subjects(Gpu("cpu", (), driver=True).troubles()) == [("GPU", False)]
    assert not list(Gpu("CUDA 12.4", ("H100",), driver=True).troubles())


def test_the_processor_is_that_of_the_system(monkeypatch):
    info = "model name\t: AMD EPYC 7B13\nflags\t\t: fpu sse2 avx avx2\n"
    texts = {"/proc/cpuinfo": info, "/sys/fs/cgroup/cpu.max": "150000 100000\n"}
    monkeypatch.setattr(machine, "_text", lambda path: texts.get(str(path), ""))
    found = machine.find_processor()
    assert (found.name, found.vectors, found.quota) == ("AMD EPYC 7B13", "AVX2", 1.5)
    texts["/sys/fs/cgroup/cpu.max"] = "max 100000\n"
    assert machine.find_processor().quota is None


def test_a_container_s_limit_counts_as_memory(monkeypatch):
    texts = {
        "/proc/meminfo": "MemTotal:       16000000 kB\nMemAvailable:    9000000 kB\n",
        "/sys/fs/cgroup/memory.max": "4096000000\n",
        "/sys/fs/cgroup/memory.current": "1096000000\n",
    }
    monkeypatch.setattr(machine, "_text", lambda path: texts.get(str(path), ""))
    found = machine.find_memory()
    assert (found.total, found.available) == (4096000000, 3000000000)


def test_a_disk_that_is_full_fails_and_one_on_a_network_is_doubtful():
    here = Folder(folders.CACHE, Path("cache"), True, "", 0, 10**7, "nfs4")
    assert subjects(here.troubles()) == [("folders", True), ("folders", False)]
    assert not list(replace(here, free=10**11, file_system="ext4").troubles())


def test_compiled_loops_that_cannot_be_kept_are_slow_and_fail_nothing():
    folder = Folder(folders.COMPILED, Path("x"), True, "read-only", 0, None, "")
    assert subjects(folder.troubles()) == [("folders", False)]


def test_a_slow_step_is_named_with_how_much():
    fast = Timing("describe a scan", 20.0, 20.0, 40.0)
    assert not list(fast.troubles())
    slow = replace(fast, milliseconds=20.0 * (SLOW + 1), first=9000.0)
    told = [str(trouble) for trouble in slow.troubles()]
    assert "describe a scan: 80 ms, 4 times the 20 ms of the docs" in told[0]
    assert "9.0 s the first time, as loops were compiled" in told[1]
    assert not list(replace(fast, first=None).troubles())


def test_the_docs_state_the_times_that_the_command_compares_with():
    rows = re.findall(r"^\| (.+?) \| (.+?) \|", DOCS.read_text(encoding="utf-8"), re.MULTILINE)
    stated = {step: time_text(milliseconds) for step, milliseconds in STATED.items()}
    assert stated == {step: time for step, time in rows if step in STATED}
