"""What ``all`` takes of ``conf/method``, whatever is added there."""

import shutil

import pytest
import yaml

from deepring.data.readers import open_session
from deepring.data.scans.columns import label_path
from deepring.errors import ConfigError
from deepring.experiment.config_groups import config_folder
from deepring.experiment.dataset_columns import lacking_columns
from deepring.experiment.entries import method_entries
from deepring.experiment.every_method import every_method

ENTRIES = method_entries(config_folder())


def have_all(_columns):
    return {}


def have_none(columns):
    return {column: ["yard"] for column in columns}


def entries_of(folder, **files):
    (folder / "method").mkdir(parents=True)
    for name, text in files.items():
        (folder / "method" / f"{name}.yaml").write_text(text)
    return method_entries(folder)


@pytest.mark.parametrize("lacking", [have_all, have_none])
@pytest.mark.parametrize("kind", ["learned", "fixed"])
def test_every_entry_is_taken_or_left_out_with_its_reason(kind, lacking):
    choice = every_method(kind, ENTRIES, lacking)
    named = [name for names in choice.left_out.values() for name in names]
    of_kind = [entry.name for entry in ENTRIES if entry.learns == (kind == "learned")]
    assert sorted([*choice.names, *named]) == sorted(of_kind)
    assert all(name in str(choice) for name in named)
    needing = {entry.name for entry in ENTRIES if entry.columns}
    assert not (lacking is have_none and needing & set(choice.names))


def test_every_learned_class_is_taken_once_and_in_a_cpu_size():
    names = every_method("learned", ENTRIES, have_all).names
    taken = {entry.target for entry in ENTRIES if entry.name in names}
    assert taken == {entry.target for entry in ENTRIES if entry.learns}
    assert len(names) == len(taken), "two networks of one name would be one row of a table"
    known = {entry.name for entry in ENTRIES}
    assert not [name for name in names if name.endswith("_gpu") or f"{name}_small" in known]


def test_every_variant_is_taken_of_what_learns_nothing():
    names = every_method("fixed", ENTRIES, have_all).names
    assert {"fast_histogram", "fast_histogram_clear", "m2dp_signs", "ssc"} <= set(names)
    assert "ssc" not in every_method("fixed", ENTRIES, have_none).names


def test_no_two_that_learn_nothing_have_one_name_in_tables():
    files = [config_folder() / "method" / f"{e.name}.yaml" for e in ENTRIES if not e.learns]
    labels = [yaml.safe_load(file.read_text())["label"] for file in files]
    assert len(set(labels)) == len(labels)


def test_a_stand_in_takes_the_place_of_a_network_whose_labels_are_not_there():
    assert "rinet_small" in every_method("learned", ENTRIES, have_all).names
    choice = every_method("learned", ENTRIES, have_none)
    assert "rinet_heights" in choice.names
    assert "rinet_small (needs labels, missing in yard)" in str(choice)


def test_what_is_added_to_the_folder_is_found(tmp_path):
    network = "# @package _global_\ndefaults: [/settings@method: disco]\nmethod: {widths: [2, 2]}"
    entries = entries_of(
        tmp_path,
        own=network,
        own_small="defaults: [own]",
        own_gpu="defaults: [own_small]",
        plain="defaults: [/settings@_here_: ring]",
        classes="defaults: [/settings@_here_: ssc]",
    )
    assert every_method("learned", entries, have_all).names == ["own_small"]
    fixed = every_method("fixed", entries, have_none)
    assert str(fixed) == "1 method; left out 1: classes (needs labels, missing in yard)"
    with pytest.raises(ConfigError, match=r"fixed: all, expected at least one method; 0 methods"):
        every_method("fixed", [e for e in entries if e.name == "classes"], have_none)


def test_the_data_are_asked_only_where_it_matters(tmp_path):
    def asked(columns):
        raise AssertionError(columns)

    entries = entries_of(tmp_path, plain="defaults: [/settings@_here_: ring]")
    assert every_method("fixed", entries, asked).names == ["plain"]


def test_datasets_that_lack_a_column_are_named(composed, tiny_custom, tmp_path):
    def lacking(drive):
        cfg = composed("data=sim_custom", f"data.root={drive / 'drive.yaml'}")
        return lacking_columns(cfg, ["label"])

    assert lacking(tiny_custom) == {"label": ["sim_custom"]}
    labelled = shutil.copytree(tiny_custom, tmp_path / "labelled")
    for side in ("map", "query"):
        session = open_session("custom", labelled / "drive.yaml", side)
        label_path(session.files[0]).parent.mkdir()
    assert lacking(labelled) == {}
