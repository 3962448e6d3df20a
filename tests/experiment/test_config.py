"""The config as types: misspelt keys and wrong types are refused, by name."""

import dataclasses
import re
import shlex
from itertools import combinations
from pathlib import Path

import pytest
from hydra.errors import ConfigCompositionException
from omegaconf import OmegaConf

from deepring.data.readers import reader_names
from deepring.errors import DeepringError
from deepring.experiment import build
from deepring.experiment.config_groups import chosen_options, config_folder, group_options
from deepring.experiment.hyperparameters import INTEREST, hyperparameters
from deepring.experiment.plan import plan_evaluation
from deepring.experiment.record import record_of
from deepring.methods.deepring import SIMILARITIES
from deepring.methods.network import NetworkMethod
from deepring.nn.aggregation import AGGREGATIONS
from deepring.paper.flat import flatten
from deepring.rasters import Preprocessing

ROOT = "data.root=/nowhere"
ROOTS = ("nclt", "mulran", "kitti")
DOCUMENTS = Path(__file__).parents[2]


def test_defaults_are_the_papers(composed):
    cfg = composed(ROOT)
    assert (*(cfg.sampling[name] for name in ("ways", "shots", "queries")),) == (24, 1, 6)
    assert (cfg.trainer["max_epochs"], cfg.sampling["per_epoch"]) == (20, 60)
    assert (cfg.optimizer["lr"], cfg.optimizer["weight_decay"]) == (1e-3, 1e-4)
    assert (cfg.scheduler["milestones"], cfg.scheduler["gamma"]) == ([5, 12], 0.1)
    assert (cfg.data.spacing.database, cfg.data.spacing.query) == (20, 5)
    assert cfg.evaluation.radii[0] == 10


def test_defaults_are_the_librarys(composed):
    cfg = composed(ROOT)
    network = build.method(cfg.method)
    assert network.settings == type(network.settings)()
    assert cfg.preprocessing == {**dataclasses.asdict(Preprocessing()), "height": [-5, 20]}
    assert cfg.method["raster"]["preprocessing"] == cfg.preprocessing


def test_one_preprocessing_is_all_methods(composed):
    cfg = composed(ROOT, "preprocessing=band")
    methods = [build.method(cfg.method), *build.fixed_methods(cfg).values()]
    heights = [method.raster.preprocessing.height for method in methods]
    # The original Scan Context's is its own.
    assert heights == [(1, 20), (1, 20), (-2, 100), (1, 20)]


@pytest.mark.parametrize(
    "key", ["data.rooot", "sampling.wayz", "trainer.max_epoch", "method.encoder.widhts"]
)
def test_a_misspelt_key_is_refused(composed, key):
    with pytest.raises((DeepringError, ConfigCompositionException), match=key.split(".")[1]):
        composed(f"{key}=3")


@pytest.mark.parametrize(
    ("override", "key"),
    [
        ("data.spacing.query=far", "data.spacing.query"),
        ("+data.surprise=1", "surprise"),
        ("evaluation.over=some", "evaluation.over"),
        ("evaluation.radii=[10,10]", "evaluation.radii"),
        ("evaluation.radii=[-5]", "evaluation.radii"),
        ("evaluation.regions=[everywhere]", "evaluation.regions"),
        ("seed=-1", "seed"),
        ("overlap=perhaps", "overlap"),
    ],
)
def test_a_wrong_value_names_its_key(composed, override, key):
    with pytest.raises((DeepringError, ConfigCompositionException)) as error:
        composed(ROOT, override)
    assert key.split(".")[-1] in f"{error.value} {error.value.__cause__}"


@pytest.mark.parametrize("name", sorted(p.stem for p in (config_folder() / "sampling").iterdir()))
def test_a_sampling_config_states_its_schemes_defaults(composed, name):
    scheme = build.scheme(composed(ROOT, f"sampling={name}").sampling)
    assert scheme == type(scheme)()


def test_a_missing_value_names_its_key(composed):
    with pytest.raises(DeepringError, match=r"data\.root=VALUE"):
        composed("data=nclt")


def test_a_downloads_folder_is_said_once_for_all_runs(composed):
    cfg = composed("train=nclt", "test=[mulran,kitti]", *(f"paths.roots.{n}=/{n}" for n in ROOTS))
    roots = [node.root for node in (*cfg.train_data.values(), *cfg.test_data.values())]
    assert roots == [f"/{name}" for name in ROOTS]
    assert composed("data=nclt", "data.root=/own", "paths.roots.nclt=/nclt").data.root == "/own"
    with pytest.raises(DeepringError, match=r"train_data\.mulran\.root=VALUE"):
        composed("train=mulran", "paths.roots.nclt=/nclt")


@pytest.mark.parametrize(
    ("override", "complaint"),
    [
        ("method.encoder.tau_padding=round", "tau_padding"),
        ("method.encoder.norm=layer", r"encoder\.norm"),
        ("method.raster.kind=cubes", r"raster\.kind"),
        ("method.similarity.normalisation=max", r"similarity\.normalisation"),
        ("method.aggregation.kind=sum", r"aggregation\.kind"),
        ("method.representation.pool=7", r"representation\.pool"),
        ("method.representation.angles=null", r"representation\.angles"),
        ("method/aggregation=dft2", r"no directions to search over"),
        ("preprocessing.extent=50", r"preprocessing\.extent"),
        ("+optimizer.momentum=1", r"optimizer\.momentum: unknown to .*, expected one of lr, "),
        ("optimizer.lr=-1", r"optimizer\.lr: -1, expected a number of at least 0"),
        ("~sampling", "sampling: null"),
        ("sampling.ways=many", r"sampling\.ways: 'many', expected a whole number"),
        ("sampling.ways=1", r"sampling\.ways: 1"),
        ("sampling.positive_radius=near", r"sampling\.positive_radius: 'near', expected a number"),
        ("+sampling.wayz=3", r"sampling\.wayz: unknown, expected one of ways, shots"),
        ("sampling._target_=deepring.training.episodes.Triplet", r"sampling\._target_: .*Triplet"),
    ],
)
def test_values_that_no_network_takes_are_refused(composed, override, complaint):
    cfg = composed(ROOT, override)
    with pytest.raises(DeepringError, match=complaint):
        build.module(cfg, [], build.method(cfg.method)).configure_optimizers()


@pytest.mark.parametrize("kind", ["sinogram", "sinogram_half", "polar_gram", "range_image"])
@pytest.mark.parametrize("aggregation", ["dft", "gap", "gmp", "multi_gap"])
def test_every_representation_goes_with_every_aggregation(composed, kind, aggregation):
    cfg = composed(
        ROOT,
        f"method/representation={kind}",
        f"method/aggregation={aggregation}",
        "method/encoder=unet_small",
    )
    assert build.method(cfg.method).representation.rows == 120


def test_every_variant_composes_and_the_experiments_pooling_stays(composed):
    variants = sorted(path.stem for path in (config_folder() / "variant").glob("*.yaml"))
    assert "triplet_dft2" in variants
    for variant in variants:
        cfg = composed(ROOT, "experiment=demo", f"variant={variant}")
        module = build.module(cfg, [], build.method(cfg.method))
        assert module.method.representation.rows == 60


def test_a_table_iii_row_changes_what_it_names_and_nothing_else(composed):
    def values(*overrides):
        return flatten(record_of(composed(ROOT, "experiment=demo", *overrides)))

    ours = values("variant=ours")
    assert ours == values()

    def changed(variant):
        other = values(f"variant={variant}")
        keys = {key for key in ours.keys() | other.keys() if ours.get(key) != other.get(key)}
        return {re.sub(r"^(method\.\w+|\w+).*", r"\1", key) for key in keys}

    assert changed("pg") == {"method.raster", "method.representation"}
    assert changed("gap") == changed("gmp") == changed("multi_gap") == {"method.aggregation"}
    assert changed("triplet") == {"loss", "method.similarity"}
    assert changed("streets") == changed("streets_smooth_ap") == {"loss", "sampling"}
    assert changed("graded") == changed("overlapping") == {"loss", "sampling"}
    assert changed("neighbours") == {"sampling"}
    assert changed("triplet_dft2") == {"loss", "method.similarity", "method.aggregation"}


#: What goes with an option, where the defaults do not.
BESIDE = {
    "sampling=batch_hard": ["loss=batch_hard", "sampling.turned=false"],
    "sampling=streets": ["loss=graded_cross_entropy"],
    "sampling=tuples": ["loss=lazy_quadruplet"],
    "sampling=pairs": ["loss=contrastive"],
    "sampling=correspondences": ["method=dh3d", "stage=dh3d_local"],
    "loss=n_tuple": ["method=dh3d", "stage=dh3d_local"],
    "loss=reliability": ["method=dh3d", "stage=dh3d_local"],
    **{
        f"{group}=dh3d_{part}{size}": [f"method=dh3d{size}"]
        for group in ("stage", "stages")
        for part in ("local", "detector", "place", "whole")
        for size in ("", "_small")
    },
    "loss=contrastive": ["sampling=pairs"],
    "loss=soft_match": ["sampling=pairs", "method=rinet"],
    "loss=triplet_with_pose": ["sampling=poses", "method=lcdnet"],
    "sampling=poses": ["loss=triplet_with_pose", "method=lcdnet"],
    "loss=overlap_and_turn": ["sampling=overlaps", "method=overlapnet"],
    "sampling=overlaps": ["loss=overlap_and_turn", "method=overlapnet"],
    "sampling=segments": ["loss=segment_identity", "method=locus"],
    "loss=segment_identity": ["sampling=segments", "method=locus"],
    "loss=batch_hard": ["sampling=batch_hard", "sampling.turned=false"],
    "loss=batch_softmax": ["sampling=batch_hard", "sampling.turned=false"],
    "loss=batch_softmax_with_turn": ["sampling=batch_hard", "method=disco_small"],
    "loss=lazy_quadruplet": ["sampling=tuples"],
    "loss=quadruplet_with_turn": ["sampling=tuples", "method=disco"],
    "method/aggregation=dft2": ["method/similarity=l2"],
}
#: But for methods, each of which `test_methods` composes and builds.
OPTIONS = [
    f"{group}={option}"
    for group, options in group_options(config_folder()).items()
    for option in options
    if group != "method"
]


@pytest.mark.parametrize("choice", OPTIONS)
def test_every_option_of_every_group_composes_and_builds(choice, composed):
    downloads = [f"paths.roots.{name}=/{name}" for name in reader_names()]
    cfg = composed(*downloads, choice, *BESIDE.get(choice, []))
    method = build.method(cfg.method)
    build.fixed_methods(cfg)
    build.datasets(cfg)
    if isinstance(method, NetworkMethod):
        build.module(cfg, [], method).configure_optimizers()


def test_groups_and_their_defaults_are_known_without_composing():
    options = group_options(config_folder())
    for name in ("train", "evaluate"):
        chosen = chosen_options(config_folder(), name)
        assert {"data": "sim_nclt", "preprocessing": "local_minimum"}.items() <= chosen.items()
        assert all(option is None or option in options[group] for group, option in chosen.items())
    assert chosen["method"] is None
    train = chosen_options(config_folder(), "train")
    assert (train["method"], train["method/encoder"], train["sweep"]) == ("deepring", "unet", None)
    assert set(options) == set(train), "a group that nothing takes an option of"
    assert options["train"] == sorted([*options["data"], "few_worlds", "many_worlds"])
    assert options["test"] == sorted([*options["data"], "validation_worlds"])
    assert {"unet", "unet_small"} <= set(options["method/encoder"])


def test_the_generated_names_are_the_librarys():
    options = group_options(config_folder())
    assert set(options["method/aggregation"]) == set(AGGREGATIONS)
    assert set(options["method/similarity"]) == set(SIMILARITIES)


def lines_of(folder, name):
    return (config_folder() / folder / f"{name}.yaml").read_text().splitlines()


@pytest.mark.parametrize(
    "name", ["aggregation", "episodes", "loss", "representation", "table3", "way"]
)
def test_each_ablation_names_its_command_and_every_job_of_it_composes(composed, name):
    assert lines_of("sweep", name)[1] == f"# deepring train -m sweep={name}"
    params = OmegaConf.create("\n".join(lines_of("sweep", name))).hydra.sweeper.params
    assert params.pop("seed") == "0,1,2"
    settings = []
    for key, values in params.items():
        for value in str(values).split(","):
            cfg = composed(f"sweep={name}", f"{key}={value}", "seed=1")
            assert cfg.sweep_name == name
            assert cfg.data.root.endswith("sim_nclt_seed1")
            assert build.fixed_methods(cfg) == {}  # the network alone, again and again
            module = build.module(cfg, [], build.method(cfg.method))
            settings.append((module.hparams, cfg.sampling))
    assert len(settings) > 2
    assert all(a != b for a, b in combinations(settings, 2))


@pytest.mark.parametrize("name", ["learned", "fixed"])
def test_every_job_of_a_comparison_composes(composed, name):
    assert lines_of("sweep", name)[1] == f"# deepring train -m sweep={name}"
    params = OmegaConf.create("\n".join(lines_of("sweep", name))).hydra.sweeper.params
    for method in str(params.method).split(","):
        cfg = composed(f"sweep={name}", f"method={method}", "seed=1")
        assert build.learns(cfg.method) == (name == "learned")
        assert {data.name for data in cfg.test_data.values()} == {"sim_nclt", "sim_mulran"}


def test_an_ablation_runs_on_the_experiment_and_the_data_one_names(composed):
    own = composed("sweep=table3", "variant=pg", "experiment=paper_nclt", "data.root=/nclt")
    assert (own.data.name, own.data.database, own.data.root) == ("nclt", "2012-02-04", "/nclt")
    assert own.method["encoder"]["widths"] == [64, 128, 256, 512]
    assert own.method["raster"]["kind"] == "polar"
    city = composed("sweep=table3", "variant=pg", "data=sim_mulran_worlds", "seed=2")
    assert city.data.root.endswith("sim_mulran_seed2")
    assert city.method["encoder"]["widths"] == [8, 16, 32]


def test_hparams_shows_first_what_sweeps_vary(composed):
    cfg = composed(ROOT, "experiment=demo", "variant=triplet", "seed=3")
    values = hyperparameters(record_of(cfg))
    first = list(INTEREST)[:5]
    assert first == ["method", "loss", "ways", "seed", "data"]
    assert [values[key] for key in first] == ["DeepRing", "Triplet", 24, 3, "sim_nclt"]
    further = ("aggregation", "encoder", "input", "more.loss.margin")
    assert [values[key] for key in further] == ["DFT", "8-16-32 x1", "SG", 0.5]
    assert all(isinstance(value, bool | str | float | int) for value in values.values())
    assert {key for key in values if not key.startswith("more.")} <= set(INTEREST)
    assert "more.optimizer.lr" not in values  # once is enough


def test_hparams_of_a_method_that_learns_nothing_are_its_own(composed):
    cfg = composed("method=ring", "test=[sim_mulran]")
    values = hyperparameters(record_of(cfg))
    short = {key: value for key, value in values.items() if not key.startswith("more.")}
    assert short == {"method": "RING", "data": "sim_mulran", "seed": cfg.seed}


def test_a_polar_branch_is_chosen_changed_and_shown(composed):
    plain = composed("method=deepring_small")
    assert build.method(plain.method).settings.polar is None
    assert "polar" not in hyperparameters(record_of(plain))
    cfg = composed("method=deepring_small", "method/polar=bev", "method.polar.share=0.4")
    method = build.method(cfg.method)
    assert method.polar.share.item() == pytest.approx(0.4)
    assert method.descriptor_shape == (60, 31 + 60)
    assert hyperparameters(record_of(cfg))["polar"] == "8-16-32 x1, share 0.4"
    for wrong in ("method.polar.share=1", "method.polar.widths=[0]", "method.polar.radius=90"):
        with pytest.raises(DeepringError, match=wrong[7:].partition("=")[0].replace(".", r"\.")):
            build.method(composed("method=deepring_small", "method/polar=bev", wrong).method)


def test_methods_are_built_with_their_rasters(composed):
    methods = build.fixed_methods(composed(ROOT))
    assert list(methods) == ["RING", "Scan Context 20x60", "Scan Context 120x120"]
    assert methods["RING"].raster.preprocessing.clearance == 0.5
    assert methods["Scan Context 20x60"].raster.shape == (60, 20)
    assert methods["Scan Context 20x60"].raster.preprocessing.clearance is None


def test_no_method_at_all_is_refused(composed):
    cfg = composed(
        ROOT, *(f"methods.{m}=null" for m in ("ring", "scan_context", "scan_context_120"))
    )
    with pytest.raises(DeepringError, match="nothing to evaluate"):
        plan_evaluation(cfg)


def commands():
    """Every `deepring train` and `deepring evaluate` of the README and the docs."""
    for page in (DOCUMENTS / "README.md", *sorted((DOCUMENTS / "docs").glob("*.md"))):
        text = page.read_text().replace("\\\n", " ")
        lines = [line.partition(" #")[0] for line in text.splitlines()]
        inline = re.findall(r"`(deepring (?:train|evaluate) [^`]*)`", re.sub(r"\s+", " ", text))
        for command in dict.fromkeys([*lines, *inline]):
            words = command.split()
            meant = words[:2] in (["deepring", "train"], ["deepring", "evaluate"])
            # A method and a scheme of one's own have tests of their own.
            strange = any(word in command for word in ("mine", "partners", "--help"))
            if meant and len(words) > 2 and not strange:
                yield page.name, command.strip()


@pytest.mark.parametrize(("page", "command"), list(commands()))
def test_every_command_of_the_docs_composes(page, command, composed):
    _, name, *arguments = shlex.split(command)
    overrides = [
        argument
        for argument in arguments
        if "=" in argument and not argument.startswith(("hydra", "-"))
    ]
    if "-m" in arguments:  # the first job
        overrides = [re.sub(r"=([^\[{]*?),.*", r"=\1", override) for override in overrides]
    given = {override.partition("=")[0] for override in overrides}
    keys = {name: f"paths.roots.{name}" for name in reader_names()}
    downloads = [f"{key}=/{name}" for name, key in keys.items() if key not in given]
    cfg = composed(*downloads, *overrides, name=name)
    if cfg.method is not None:
        assert build.method(cfg.method).raster.shape


def test_the_augmentation_is_none_unless_chosen(composed):
    assert build.augmentation(composed(ROOT, "method=deepring_small").augmentation) is None
    chosen = build.augmentation(composed(ROOT, "augmentation=partial").augmentation)
    assert (chosen.blind, chosen.blind_width, chosen.dropped) == (0.7, (20.0, 130.0), 0.3)
    with pytest.raises(DeepringError, match=r"augmentation\.blind: 2"):
        build.augmentation(
            composed(ROOT, "augmentation=partial", "augmentation.blind=2").augmentation
        )
