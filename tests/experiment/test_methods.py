"""Every method's config: it composes, names its command, trains, and is loaded as what it is."""

import pytest
from hydra.errors import ConfigCompositionException
from omegaconf import OmegaConf

from deepring.errors import ConfigError, DeepringError
from deepring.experiment import build
from deepring.experiment.config_groups import config_folder, group_options
from deepring.experiment.entries import method_entries
from deepring.experiment.plan import plan_evaluation
from deepring.experiment.record import record_of
from deepring.experiment.train import train
from deepring.methods.network_file import load_network
from helpers.small_training import SMALL, TINY_DATA, TINY_METHODS

ENTRIES = method_entries(config_folder())
METHODS = [entry.name for entry in ENTRIES]
FIXED = (
    *("ring", "ring_plus_plus", "scan_context", "scan_context_120", "ssc"),
    *("fast_histogram", "fast_histogram_clear", "m2dp", "m2dp_signs", "lidar_iris"),
    *("polar_context", "polar_context_augmented", "cart_context", "cart_context_augmented"),
)
LEARNED = [name for name in METHODS if name not in FIXED]

#: Learned methods that take the raw scan, ground and all, as published.
RAW = (
    *("locnet", "locnet_small", "rinet", "rinet_small"),
    *("overlapnet", "overlapnet_small"),
    "lcdnet",
)

#: Methods that need classes of points; see `test_labelled_evaluation`.
LABELLED = ("rinet",)


#: The networks at published size that are trained otherwise, with pairs and cross-entropy.
GPU = [name for name in METHODS if name.endswith("_gpu")]
PAIRS = (
    *("sampling.size=4", "sampling.limit=6", "sampling.per_epoch=2", "workers=0"),
    *("sampling.positive_radius=10", "sampling.negative_radius=20"),
)


def tiny(method):
    name = method.removesuffix("_gpu").removesuffix("_heights")
    network = [o for o in TINY_METHODS[name] if not o.startswith("sampling.")]
    return (*network, *PAIRS) if method in GPU else TINY_METHODS[name]


def test_every_option_for_a_method_is_tried():
    assert sorted(METHODS) == group_options(config_folder())["method"]


@pytest.mark.parametrize("method", METHODS)
def test_each_method_names_its_command_and_says_whether_it_learns(method, composed):
    lines = (config_folder() / "method" / f"{method}.yaml").read_text().splitlines()
    assert f"# deepring train method={method}" in lines[:2]
    cfg = composed("data.root=/nowhere", f"method={method}")
    (entry,) = [each for each in ENTRIES if each.name == method]
    assert build.learns(cfg.method) == entry.learns == (method in LEARNED)
    made, fixed = build.method(cfg.method), build.fixed_methods(cfg)
    build.datasets(cfg)
    assert made.raster.columns == entry.columns
    if method in LEARNED:
        module = build.module(cfg, [], made)
        module.configure_optimizers()
        clearance = None if method in RAW else 0.5  # the comparison's
        assert made.raster.preprocessing.clearance == clearance
    else:
        assert len(fixed) == 4 - (method in cfg.methods)


@pytest.mark.parametrize("method", GPU)
def test_what_is_meant_for_a_gpu_has_the_published_size(method, composed):
    name = method.removesuffix("_gpu")
    ours, published = (
        build.network_settings(composed("data.root=/nowhere", f"method={m}").method).to_dict()
        for m in (method, name)
    )
    changed = {key for key, value in published.items() if ours[key] != value}
    assert changed == {"disco": {"signature"}, "egonn": {"normalised"}}.get(name, set())


def test_every_learned_baseline_has_a_cpu_and_a_gpu_size():
    assert {"disco", "egonn", "pointnetvlad"} == {m.removesuffix("_gpu") for m in GPU}
    assert {f"{m.removesuffix('_gpu')}_small" for m in GPU} < set(METHODS)


@pytest.mark.parametrize(
    "method", [m for m in LEARNED if not m.endswith("_small") and m not in LABELLED]
)
def test_each_learned_method_trains_and_its_checkpoint_knows_it(
    method, composed, tiny_nclt, tmp_path
):
    cfg = composed(
        *(f"data.root={tiny_nclt}", f"method={method}", *tiny(method), *TINY_DATA),
        *(
            "trainer.max_epochs=1",
            "trainer.log_every_n_steps=1",
            "callbacks.progress=null",
            "evaluation.figures=false",
        ),
        *("methods.ring=null", "methods.scan_context=null", "methods.scan_context_120=null"),
    )
    trained = train(cfg, tmp_path / "run")
    loaded = load_network(trained.checkpoint).method
    assert {r.case.method for r in trained.results} == {loaded.settings.label}
    assert loaded.settings == build.network_settings(cfg.method)
    kept = OmegaConf.load(tmp_path / "run" / "config.yaml")
    assert kept.method._target_.endswith(type(loaded).__name__)


@pytest.fixture(scope="module")
def disco_run(compose_in, tiny_nclt, tmp_path_factory):
    outputs = tmp_path_factory.mktemp("disco")
    cfg = compose_in(
        outputs,
        *(f"data.root={tiny_nclt}", "method=disco", *TINY_METHODS["disco"], *TINY_DATA),
        *(
            "trainer.max_epochs=1",
            "trainer.log_every_n_steps=1",
            "callbacks.progress=null",
            "evaluate=false",
        ),
    )
    return train(cfg, outputs / "run")


@pytest.mark.parametrize("asked", ["deepring", "egonn", "ring"])
def test_a_checkpoint_of_one_method_is_not_loaded_as_another(asked, disco_run, composed, tiny_nclt):
    cfg = composed(f"data.root={tiny_nclt}", f"method={asked}", name="evaluate")
    with pytest.raises(DeepringError, match=r"holds a network of DiSCO .*, but method asks for"):
        plan_evaluation(cfg, disco_run.checkpoint)


def test_without_a_method_the_checkpoints_is_taken(disco_run, composed, tiny_nclt):
    cfg = composed(f"data.root={tiny_nclt}", *TINY_DATA, name="evaluate")
    plan = plan_evaluation(cfg, disco_run.checkpoint)
    assert plan.network.settings.label == "DiSCO"
    assert plan.record["method"] == {
        "_target_": "deepring.methods.disco.Disco",
        **plan.network.settings.to_dict(),
    }


def test_a_run_is_not_resumed_as_another_method(disco_run, composed, tiny_nclt, tmp_path):
    last = disco_run.folder / "checkpoints" / "last.ckpt"
    cfg = composed(f"data.root={tiny_nclt}", *SMALL, "method/encoder=unet_small", f"resume={last}")
    with pytest.raises(DeepringError, match="trained with other method"):
        train(cfg, tmp_path / "run")


@pytest.mark.parametrize(
    ("overrides", "complaint"),
    [
        (["method=disco", "sampling=episodes"], r"sampling\.per_batch: unknown, expected one of"),
        (["sampling=tuples"], "loss: OneShotCrossEntropy, expected .*TupleLoss"),
        (["method=disco", "loss=batch_hard"], "loss: BatchHardTriplet, expected .*TupleLoss"),
        (["method=disco", "method.size=64"], r"disco\.size: 64"),
        (["method=disco", "+method.depth=3"], r"method\.depth: unknown, expected one of raster, w"),
        (["+method.encoder.depth=3"], r"method\.encoder\.depth: unknown, expected one of widths"),
        (["method=disco", "method.raster.kind=bev"], r"method\.raster\.layers"),
        (["method.encoder.widths=8"], r"method\.encoder\.widths: 8, expected a list"),
        (["method.encoder.stem=two"], r"method\.encoder\.stem: 'two', expected a whole number"),
        (["method.encoder=null"], r"method\.encoder: None, expected values by name: widths"),
        (
            ["method.representation.theta_range=third"],
            r"theta_range: 'third', expected one of full, half",
        ),
        (["method._target_=deepring.methods.ring.Rang"], r"method\._target_: .*Rang"),
        (["method=ring", "method.angles=many"], r"method\.angles: 'many', expected a whole number"),
        (["method=ring", "+method.angels=60"], r"method\.angels: unknown, expected one of angles"),
    ],
)
def test_what_does_not_go_together_is_refused(overrides, complaint, composed):
    cfg = composed("data.root=/nowhere", *overrides)
    with pytest.raises(DeepringError, match=complaint):
        build.module(cfg, [], build.method(cfg.method))


def test_deeprings_groups_are_refused_with_another_method(composed):
    with pytest.raises(ConfigCompositionException, match="method/representation"):
        composed("data.root=/nowhere", "method=disco", "method/representation=polar_gram")


def test_one_node_is_the_method_and_one_evaluated_besides(composed):
    cfg = composed("data.root=/nowhere", "method=ring")
    assert cfg.method == cfg.methods["ring"]
    further = composed("data.root=/nowhere", "+method@methods.plus=ring_plus_plus")
    assert "RING++" in build.fixed_methods(further)


@pytest.mark.parametrize(
    "overrides",
    [
        ["method=ring", "method.correlation=published"],
        ["+method@methods.plus=ring", "methods.plus.correlation=published"],
        ["+method@methods.plus=ring_plus_plus", "methods.plus.label=DeepRING"],
    ],
)
def test_two_methods_that_differ_do_not_share_a_label(overrides, composed):
    cfg = composed("data.root=/nowhere", *overrides)
    with pytest.raises(ConfigError, match=r"methods\.\w+\.label: '(RING|DeepRING)', the label of"):
        build.fixed_methods(cfg)


def test_of_a_method_that_learns_nothing_no_training_is_recorded(composed):
    record = record_of(composed("data.root=/nowhere", "method=ring"))
    assert record["loss"] is record["optimizer"] is record["sampling"] is None
    assert record_of(composed("data.root=/nowhere"))["loss"]["temperature_scale"] == 100
