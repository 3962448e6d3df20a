"""Files from strangers run nothing, import nothing, and name no paths; docs/security.md."""

import shutil

import numpy as np
import pytest
import torch
from rosbags import typesys

from deepring.data.readers import open_session
from deepring.data.scans.bag_files import bag_scans
from deepring.data.scans.scan_files import read_scan
from deepring.errors import DeepringError
from deepring.evaluation.case import Case
from deepring.evaluation.descriptors import DescriptorSet, free_path, write_descriptors
from deepring.evaluation.fingerprint import fingerprint
from deepring.evaluation.matches import TopMatches, write_matches
from deepring.evaluation.scoring import find_pairs, score_pair
from deepring.experiment.run_folder import read_config
from deepring.localization.map import Map
from deepring.methods.network_file import (
    TrainedNetwork,
    describe_network,
    load_network,
    weights_of,
    write_network,
)
from deepring.search.correlation_index import CorrelationIndex
from helpers.bags import KINDS, message, write_bag
from helpers.marking import TARGET, Mark, Marked
from helpers.networks import small_network
from helpers.sealed_files import parts_of, rewritten
from helpers.tiny_methods import TINY


@pytest.fixture
def mark(tmp_path):
    (tmp_path / "mark").mkdir()
    return Mark(tmp_path / "mark")


@pytest.fixture(scope="module")
def network():
    return small_network()


NAMES = [
    TARGET,
    "os.system",
    "deepring.methods.deepring.DeepRing",
    "builtins.exec",
    "../marking_module",
    "__main__.Anything",
    "deepring\0",
    "",
]


@pytest.mark.parametrize("name", NAMES)
def test_a_map_imports_no_class_that_it_names(name, network, mark, tmp_path):
    Map(network).save(tmp_path / "a.map")
    described = parts_of(tmp_path / "a.map")[0]["values"]["network"]
    rewritten(tmp_path / "a.map", values={"network": {**described, "method": name}})
    with mark.unmarked(), pytest.raises(DeepringError, match=r"method: .* expected one of"):
        Map.open(tmp_path / "a.map", check=True)


@pytest.mark.parametrize("name", NAMES)
def test_a_network_imports_no_class_that_it_names(name, network, mark, tmp_path):
    path = tmp_path / "a.safetensors"
    write_network(path, TrainedNetwork(network, "campus", "Loss"))
    described = parts_of(path)[0]["values"]["network"]
    rewritten(path, values={"network": {**described, "method": name}})
    with mark.unmarked(), pytest.raises(DeepringError, match=r"method: .* expected one of"):
        load_network(path)


@pytest.mark.parametrize("name", NAMES)
def test_a_checkpoint_imports_no_class_that_it_names(name, network, mark, tmp_path):
    values = {**describe_network(network), "method": name, "trained_on": "a", "loss": TARGET}
    weights = {f"method.{k}": v for k, v in weights_of(network).items()}
    torch.save({"hyper_parameters": values, "state_dict": weights}, tmp_path / "a.ckpt")
    with mark.unmarked(), pytest.raises(DeepringError, match=r"method: .* expected one of"):
        load_network(tmp_path / "a.ckpt")


def described(method, side, n=3):
    rows = np.random.default_rng(0).random((n, *method.descriptor_shape), np.float32)
    return DescriptorSet(
        case=Case("A", "", "a", "test"),
        side=side,
        session="s",
        made_by=fingerprint(method),
        ground_z=0.0,
        seconds_per_scan=0.0,
        descriptors=rows,
        positions=np.arange(2.0 * n).reshape(n, 2),
        indices=np.arange(n),
    )


@pytest.mark.parametrize("name", NAMES)
def test_descriptors_import_no_class_that_they_name(name, mark, tmp_path):
    method = TINY["ring"]()
    for side in ("database", "query"):
        path = free_path(tmp_path / "d", Case("A", "", "a", "test"), side)
        write_descriptors(path, described(method, side))
        made_by = parts_of(path)[0]["values"]["made_by"]
        rewritten(path, values={"made_by": {**made_by, "method": name}})
    (pair,) = find_pairs(tmp_path / "d")
    with mark.unmarked(), pytest.raises(DeepringError, match=r"method: .* expected one of"):
        score_pair(pair)


def test_an_index_names_no_path_outside_its_folder(tmp_path):
    index = CorrelationIndex()
    index.add(torch.rand(3, 12, 9))
    index.save(tmp_path / "a")
    shutil.copytree(tmp_path / "a", tmp_path / "b")
    header = tmp_path / "b" / "index.safetensors"
    (shard,) = parts_of(header)[0]["values"]["shards"]
    rewritten(header, values={"shards": [{**shard, "path": "../a/00000.safetensors"}]})
    with pytest.raises(DeepringError, match=r"shards\[0\]\.path: unknown"):
        CorrelationIndex.open(tmp_path / "b")


def test_a_scan_of_pickled_objects_is_refused_and_not_unpickled(tmp_path, mark):
    objects = np.empty(1, dtype=object)
    objects[0] = Marked(mark.path)
    np.save(tmp_path / "a.npy", objects, allow_pickle=True)
    with mark.unmarked(), pytest.raises(DeepringError):
        read_scan(tmp_path / "a.npy")


YAML = [
    "!!python/object/apply:os.mkdir ['{mark}']",
    "!!python/name:marking_module.Anything",
    "!!python/module:marking_module",
    "!!python/object/new:marking_module.Anything []",
]


@pytest.mark.parametrize("tag", YAML)
def test_tags_in_yaml_make_nothing(tag, mark, tmp_path):
    text = f"scans: {tag.format(mark=mark.path)}\nposes: a.txt\n"
    for name in ("drive.yaml", "config.yaml"):
        (tmp_path / name).write_text(text, encoding="utf-8")
    with mark.unmarked():
        with pytest.raises(DeepringError, match="YAML"):
            open_session("custom", tmp_path / "drive.yaml")
        with pytest.raises(DeepringError, match="is not YAML of plain values"):
            read_config(tmp_path / "config.yaml")


@pytest.mark.parametrize("value", ["${oc.env:HOME}", "${oc.env:PATH,x}", "${data.root}", "${a:b}"])
def test_a_config_from_elsewhere_reads_no_environment(value, tmp_path):
    path = tmp_path / "config.yaml"
    path.write_text(f"experiment_name: {value}\ndata: {{root: x}}\n", encoding="utf-8")
    with pytest.raises(DeepringError, match="is not YAML of plain values"):
        read_config(path)


def test_aliases_within_aliases_are_refused_in_short_time(tmp_path):
    """A few lines that stand for 9^29 values, in every YAML file that is read."""
    lines = [
        "a0: &a0 [x]",
        *(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 30)),
    ]
    lines += ["scans: *a29", "rosbag2_bagfile_information: {storage_identifier: *a29}"]
    (tmp_path / "bag").mkdir()
    for name in ("config.yaml", "drive.yaml", "bag/metadata.yaml"):
        (tmp_path / name).write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(DeepringError, match="is not YAML of plain values"):
        read_config(tmp_path / "config.yaml")
    with pytest.raises(DeepringError, match=r"drive\.yaml"):
        open_session("custom", tmp_path / "drive.yaml")
    with pytest.raises(DeepringError, match=r"metadata\.yaml is damaged"):
        list(bag_scans(tmp_path / "bag"))


@pytest.mark.parametrize(
    "name", ["../../x", "/etc/passwd", "..", "a/b\\c", "C:\\x", "~root", "", "."]
)
def test_labels_are_no_paths(name, tmp_path):
    """Methods, datasets and regions name files of a run; none of these leaves its folder."""
    case = Case(name, "", name, name)
    one = np.zeros((1, 1), np.float32)
    whole = np.zeros(1, np.int64)
    matches = TopMatches(case, whole, whole[:, None], one, None, one, one[:, 0])
    run = tmp_path / "a" / "run"
    path = write_matches(run, matches)
    assert path.resolve().parent == (run / "retrievals").resolve()
    assert free_path(run, case, "query").resolve().parent == run.resolve()
    every = [p for p in tmp_path.rglob("*") if p.is_file()]
    assert every == [path]


@pytest.mark.parametrize("text", ["\x1b[31m", "a\nb", "\u202eb", "\0", "\ud800"])
def test_labels_that_do_not_print_are_refused(text):
    for values in ((text, "", "", ""), ("", text, "", ""), ("", "", text, ""), ("", "", "", text)):
        with pytest.raises(DeepringError, match="without control characters"):
            Case(*values)


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_is_read_without_the_definitions_in_it(kind, tmp_path, monkeypatch):
    """From them the library would generate code; those of its own clouds suffice."""
    path = write_bag(tmp_path, kind, {"/points": [message(np.ones((4, 3)))]})
    list(bag_scans(path))  # the library has made its own types
    for name in ("get_types_from_msg", "get_types_from_idl"):
        monkeypatch.setattr(typesys, name, None)
    monkeypatch.setattr(typesys.store.Typestore, "register", None)
    (scan,) = bag_scans(path)
    assert scan is not None
