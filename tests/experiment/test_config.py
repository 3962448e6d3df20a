"""The config as types: misspelt keys and wrong types are refused, by name."""

import dataclasses
from itertools import combinations

import pytest
from hydra.errors import ConfigCompositionException
from omegaconf import OmegaConf

from deepring.cli.train_commands import config_folder
from deepring.errors import DeepringError
from deepring.experiment import build
from deepring.experiment.config import PreprocessingConfig, flattened
from deepring.experiment.hyperparameters import hyperparameters
from deepring.experiment.plan import plan_evaluation
from deepring.rasters import Preprocessing

ROOT = "data.root=/nowhere"
ROOTS = ("nclt", "mulran", "kitti")


def test_defaults_are_the_papers(composed):
    cfg = composed(ROOT)
    assert (cfg.sampling.ways, cfg.sampling.shots, cfg.sampling.queries) == (24, 1, 6)
    assert (cfg.trainer.max_epochs, cfg.sampling.per_epoch) == (20, 60)
    assert (cfg.optimizer.lr, cfg.optimizer.weight_decay) == (1e-3, 1e-4)
    assert (list(cfg.scheduler.milestones), cfg.scheduler.gamma) == ([5, 12], 0.1)
    assert (cfg.data.spacing.database, cfg.data.spacing.query) == (20, 5)
    assert cfg.evaluation.radii[0] == 10


@pytest.mark.parametrize("key", ["data.rooot", "sampling.wayz", "trainer.max_epoch"])
def test_a_misspelt_key_is_refused(composed, key):
    with pytest.raises((DeepringError, ConfigCompositionException), match=key.split(".")[1]):
        composed(f"{key}=3")


@pytest.mark.parametrize(
    ("override", "key"),
    [
        ("data.spacing.query=far", "data.spacing.query"),
        ("+data.surprise=1", "surprise"),
        ("evaluation.over=some", "evaluation.over"),
        ("encoder.widths=8", "encoder.widths"),
    ],
)
def test_a_wrong_type_names_its_key(composed, override, key):
    with pytest.raises((DeepringError, ConfigCompositionException)) as error:
        composed(ROOT, override)
    assert key.split(".")[-1] in f"{error.value} {error.value.__cause__}"


@pytest.mark.parametrize("name", sorted(p.stem for p in (config_folder() / "sampling").iterdir()))
def test_a_sampling_config_states_its_schemes_defaults(composed, name):
    scheme = build.scheme(composed(ROOT, f"sampling={name}"))
    assert scheme == type(scheme)()


def test_a_missing_value_names_its_key(composed):
    with pytest.raises(DeepringError, match=r"data\.root=VALUE"):
        composed("data=nclt")


def test_a_downloads_folder_is_said_once_for_all_runs(composed):
    cfg = composed("train=nclt", "test=[mulran,kitti]", *(f"paths.{n}=/{n}" for n in ROOTS))
    roots = [node.root for node in (*cfg.train_data.values(), *cfg.test_data.values())]
    assert roots == [f"/{name}" for name in ROOTS]
    assert composed("data=nclt", "data.root=/own", "paths.nclt=/nclt").data.root == "/own"
    with pytest.raises(DeepringError, match=r"train_data\.mulran\.root=VALUE"):
        composed("train=mulran", "paths.nclt=/nclt")


@pytest.mark.parametrize(
    ("override", "complaint"),
    [
        ("encoder.tau_padding=round", "tau_padding"),
        ("encoder.norm=layer", r"encoder\.norm"),
        ("representation.raster.kind=cubes", r"raster\.kind"),
        ("similarity.normalisation=max", r"similarity\.normalisation"),
        ("aggregation.kind=sum", r"aggregation\.kind"),
        ("representation.pool=7", r"representation\.pool"),
        ("representation.angles=null", r"representation\.angles"),
        ("preprocessing.extent=50", r"preprocessing\.extent"),
        ("+optimizer.momentum=1", "optimizer"),
        ("~sampling", "sampling: null"),
        ("sampling.ways=many", r"sampling\.ways: 'many', expected int"),
        ("sampling.ways=1", r"sampling\.ways: 1"),
        ("sampling.positive_radius=near", r"sampling\.positive_radius: 'near', expected float"),
        (
            "+sampling.wayz=3",
            r"sampling\.wayz: unknown to EpisodeScheme, expected one of ways, shots",
        ),
        ("sampling._target_=deepring.training.episodes.Triplet", r"sampling\._target_: .*Triplet"),
    ],
)
def test_values_that_no_network_takes_are_refused(composed, override, complaint):
    cfg = composed(ROOT, override)
    with pytest.raises(DeepringError, match=complaint):
        build.module(cfg, [], build.network(cfg)).configure_optimizers()


@pytest.mark.parametrize("kind", ["sinogram", "sinogram_half", "polar_gram", "range_image"])
@pytest.mark.parametrize("aggregation", ["dft", "gap", "gmp", "multi_gap"])
def test_every_representation_goes_with_every_aggregation(composed, kind, aggregation):
    cfg = composed(
        ROOT, f"representation={kind}", f"aggregation={aggregation}", "encoder=unet_small"
    )
    assert build.module(cfg, [], build.network(cfg)).method.representation.rows in (
        60,
        120,
    )


def test_every_variant_composes_and_the_experiments_pooling_stays(composed):
    variants = sorted(path.stem for path in (config_folder() / "variant").glob("*.yaml"))
    assert "triplet_dft2" in variants
    for variant in variants:
        cfg = composed(ROOT, "experiment=demo", f"variant={variant}")
        module = build.module(cfg, [], build.network(cfg))
        assert module.method.representation.rows == 60


def test_a_table_iii_row_changes_what_it_names_and_nothing_else(composed):
    def values(*overrides):
        return flattened(build.plain(composed(ROOT, "experiment=demo", *overrides)))

    ours = values("variant=ours")
    assert ours == values()

    def changed(variant):
        other = values(f"variant={variant}")
        keys = {key for key in ours.keys() | other.keys() if ours.get(key) != other.get(key)}
        return {key.partition(".")[0] for key in keys}

    assert changed("pg") == {"representation"}
    assert changed("gap") == changed("gmp") == changed("multi_gap") == {"aggregation"}
    assert changed("triplet") == {"loss", "similarity"}
    assert changed("triplet_dft2") == {"loss", "similarity", "aggregation"}


ABLATIONS = sorted(path.stem for path in (config_folder() / "ablation").glob("*.yaml"))


@pytest.mark.parametrize("ablation", ABLATIONS)
def test_each_ablation_names_its_command_and_every_job_of_it_composes(composed, ablation):
    path = config_folder() / "ablation" / f"{ablation}.yaml"
    assert path.read_text().splitlines()[1] == f"# deepring train -m ablation={ablation}"
    params = OmegaConf.load(path).hydra.sweeper.params
    assert params.pop("seed") == "0,1,2"
    settings = []
    for key, values in params.items():
        for value in str(values).split(","):
            cfg = composed(f"ablation={ablation}", f"{key}={value}", "seed=1")
            assert cfg.sweep_name == ablation
            assert cfg.data.root.endswith("sim_nclt_seed1")
            assert build.fixed_methods(cfg) == {}  # the network alone, again and again
            module = build.module(cfg, [], build.network(cfg))
            settings.append((module.hparams, cfg.sampling.ways))
    assert len(settings) > 2
    assert all(a != b for a, b in combinations(settings, 2))


def test_an_ablation_runs_on_the_experiment_and_the_data_one_names(composed):
    own = composed("ablation=table3", "variant=pg", "experiment=paper_nclt", "data.root=/nclt")
    assert (own.data.name, own.data.database, own.data.root) == ("nclt", "2012-02-04", "/nclt")
    assert list(own.encoder.widths) == [64, 128, 256, 512]
    assert own.representation.raster["kind"] == "polar"
    city = composed("ablation=table3", "variant=pg", "data=sim_mulran_worlds", "seed=2")
    assert city.data.root.endswith("sim_mulran_seed2")
    assert list(city.encoder.widths) == [8, 16, 32]


def test_hparams_shows_first_what_sweeps_vary(composed):
    values = hyperparameters(composed(ROOT, "experiment=demo", "variant=triplet", "seed=3"))
    assert sorted(values)[:5] == ["aggregation", "data", "encoder", "input", "loss"]
    assert [values[key] for key in sorted(values)[:5]] == [
        *("DFT", "sim_nclt", "8-16-32 x1", "SG", "Triplet")
    ]
    assert (values["seed"], values["ways"], values["more.loss.margin"]) == (3, 24, 0.5)
    assert all(isinstance(value, bool | str | float | int) for value in values.values())


def test_the_config_and_the_mathematics_agree_on_preprocessing():
    ours = {field.name: field.default for field in dataclasses.fields(PreprocessingConfig)}
    assert ours == {field.name: field.default for field in dataclasses.fields(Preprocessing)}


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
