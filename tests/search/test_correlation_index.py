"""Exact search against the double sum of Eq. 8; precisions; two stages; growth and files."""

import math
import shutil

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.core.correlation import circular_cross_correlation, unit_norm
from deepring.errors import DeepringError, FileError
from deepring.search.block_store import BlockStore
from deepring.search.code import CodeSettings, code_scores, fit_code
from deepring.search.correlation_index import CorrelationIndex
from deepring.search.exact import batched, compiled
from deepring.search.search_settings import SearchSettings
from deepring.search.spectra import (
    LANES,
    best_shift,
    cross_spectra,
    decode,
    encode,
    padded_spectra,
    tail_norms,
)
from helpers.sealed_files import parts_of, rewritten

PRECISIONS = ["float32", "bfloat16", "int8"]
EXHAUSTIVE = SearchSettings(code=None)


def maps(n, rows=12, cols=7, seed=0):
    generator = torch.Generator().manual_seed(seed)
    return unit_norm(torch.rand(n, rows, cols, generator=generator) ** 3)


def index_of(database, settings=EXHAUSTIVE, **arguments):
    index = CorrelationIndex(settings, **arguments)
    index.add(database)
    return index


def brute_force(queries, database):
    """Σ_θω Q(θ + α, ω) D(θ, ω) by loops over pairs and shifts, in double precision."""
    rows = queries.shape[1]
    curves = torch.empty(len(queries), len(database), rows, dtype=torch.float64)
    for i, query in enumerate(queries.double()):
        for j, entry in enumerate(database.double()):
            for alpha in range(rows):
                curves[i, j, alpha] = (query.roll(-alpha, dims=0) * entry).sum()
    return curves


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 4), st.integers(1, 9), st.integers(2, 13), st.integers(1, 20))
def test_float32_agrees_with_the_double_sum_yaw_included(q, d, rows, cols):
    queries, database = maps(q, rows, cols, 1), maps(d, rows, cols, 2)
    curves = brute_force(queries, database)
    hits = index_of(database).search(queries, k=d)
    score = curves.amax(dim=-1)
    assert torch.allclose(hits.score.double(), score.gather(1, hits.place), atol=1e-5)
    assert torch.equal(hits.score, hits.score.sort(dim=1, descending=True).values)
    # The turn is that of a best shift: the curve there is within rounding of the maximum.
    steps = torch.round(hits.turn / (2 * math.pi) * rows).long() % rows
    reached = curves.gather(1, hits.place[..., None].expand(-1, -1, rows))
    at_yaw = reached.gather(2, steps[..., None])[..., 0]
    assert torch.allclose(at_yaw, score.gather(1, hits.place), atol=1e-5)


def test_yaw_turns_the_place_onto_the_query():
    database = maps(20, rows=24)
    hits = index_of(database).search(database[7:8].roll(5, dims=1))
    assert hits.place.item() == 7
    assert hits.turn.item() == pytest.approx(5 * 2 * math.pi / 24)  # not -5, its mirror
    half = index_of(database, period=math.pi).search(database[7:8].roll(5, dims=1))
    assert half.turn.item() == pytest.approx(5 * math.pi / 24)


@pytest.mark.parametrize("precision", PRECISIONS)
def test_precisions_stay_within_their_steps(precision):
    queries, database = maps(6, 60, 31, 1), maps(300, 60, 31, 2)
    exact = circular_cross_correlation(queries, database)
    found = index_of(database, SearchSettings(precision, code=None)).search(queries, k=300)
    bound = {"float32": 1e-5, "bfloat16": 4e-3, "int8": 4e-3}[precision]
    error = (found.score - exact.score.gather(1, found.place)).abs().max()
    assert error < bound
    if precision != "float32":
        assert error > 1e-6  # or nothing was rounded


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize(("rows", "cols"), [(10, 5), (15, 20)])
@pytest.mark.parametrize("k", [1, 3, 17])
def test_compiled_and_torch_forms_agree(precision, rows, cols, k):
    places = BlockStore()
    for seed in (0, 1):
        spectra = encode(maps(17, rows, cols, seed), precision)
        assert spectra.values.shape == (17, rows // 2 + 1, 2, -(-cols // LANES) * LANES)
        places.attach(spectra._asdict())
    planes = padded_spectra(maps(3, rows, cols, seed=9))
    for which in (None, torch.tensor([0, 2, 16, 17, 30])):
        one = compiled(places, planes, rows, k, which)
        other = batched(places, planes, rows, k, which)
        assert one.score.shape == (3, k if which is None else min(k, 5))
        assert torch.allclose(one.score, other.score, atol=1e-5)
        assert torch.equal(one.place, other.place)
        assert torch.equal(one.shift, other.shift)


@settings(max_examples=30, deadline=None)
@given(st.integers(2, 40), st.integers(0, 99))
def test_what_the_bound_leaves_out_is_not_among_the_best(rows, seed):
    database, queries = maps(60, rows, 4, seed), maps(3, rows, 4, seed + 100)
    every = circular_cross_correlation(queries, database).score
    found = index_of(database).search(queries, 4)
    assert torch.allclose(found.score, every.topk(4).values, atol=1e-5)


@pytest.mark.parametrize("precision", PRECISIONS)
def test_what_is_left_of_two_spectra_bounds_what_it_adds(precision):
    rows = 40
    places, planes = encode(maps(50, rows, 6), precision), padded_spectra(maps(4, rows, 6, 9))
    cross = torch.view_as_complex(cross_spectra(planes, places))
    weight = torch.full((rows // 2 + 1,), 2.0 / rows)
    weight[0] = weight[-1] = 1.0 / rows
    of_queries = tail_norms(planes, rows)
    assert places.tails.shape == (50, 2)  # from frequency 8 and from 16 of 21
    for j, first in enumerate((8, 16)):
        added = (cross.abs() * weight)[..., first:].sum(dim=-1)
        most = of_queries[:, None, j] * places.tails[None, :, j]
        assert (added <= most * 1.00001).all()
        # Without the first half of it, it would not hold of these: their low frequencies are large.
        whole = (cross.abs() * weight).sum(dim=-1)
        assert (whole > most).all()


def test_best_shift_takes_int8_scales_into_account():
    database = maps(5) * torch.tensor([1.0, 10.0, 100.0, 1e3, 1e-3])[:, None, None]
    score, _ = best_shift(padded_spectra(maps(2, seed=3)), encode(database, "int8"), 12)
    exact = circular_cross_correlation(maps(2, seed=3), database).score
    assert torch.allclose(score, exact, rtol=1e-2)


def test_two_stages_find_what_all_comparisons_find():
    database = maps(3000, 20, 9)
    queries = (database[::100] + 0.02 * maps(30, 20, 9, 5)).roll(3, dims=1)
    index = index_of(database, SearchSettings(candidates=40, candidate_share=0.0))
    exact = index.search(queries, k=3, exhaustive=True)
    quick = index.search(queries, k=3, exhaustive=False)
    assert torch.equal(quick.place[:, 0], exact.place[:, 0])
    assert torch.allclose(quick.score[:, 0], exact.score[:, 0], atol=1e-6)
    assert torch.equal(quick.turn[:, 0], exact.turn[:, 0])
    few = index_of(database, SearchSettings(candidates=1, candidate_share=0.0))
    assert few.candidates(queries, few.code).shape == (30, 1)


def test_the_code_is_a_bound_that_no_rotation_changes():
    database, queries = maps(40, 16, 6), maps(4, 16, 6, 8)
    code = fit_code(database, CodeSettings(frequencies=9, components=6))  # all of them
    planes = code.queries(queries)
    scores = code_scores(planes, code.encode(database))
    best = circular_cross_correlation(queries, database).score
    assert (scores >= best - 0.01).all()
    turned = code_scores(code.queries(queries.roll(5, dims=1)), code.encode(database))
    assert torch.allclose(turned, scores, atol=1e-5)
    # The size of the sum of all frequencies is no such bound: it knows one rotation only.
    unturned = (queries[:, None] * database[None]).sum(dim=(-2, -1)).abs()
    assert (unturned < best - 0.01).any()


def test_code_scores_against_complex_arithmetic():
    code = fit_code(maps(30, 10, 6), CodeSettings(4, 3))
    codes, planes = code.encode(maps(30, 10, 6)), code.queries(maps(2, 10, 6, 4))
    q = torch.complex(planes[..., 0], planes[..., 1])
    d = torch.complex(codes[:, :, 0].float(), codes[:, :, 1].float())
    expected = torch.einsum("qkp,kpn->qnk", q, d.conj()).abs().sum(dim=-1)
    assert codes.shape == (4, 3, 2, 30)
    assert torch.allclose(code_scores(planes, codes), expected, rtol=1e-5)
    assert torch.allclose(code_scores(planes, codes, 7), expected[:, :7], rtol=1e-5)


@pytest.mark.parametrize("places", [1, 511, 512, 1500])
def test_code_scores_of_any_number_of_places(places):
    generator = torch.Generator().manual_seed(0)
    codes = torch.randint(-127, 128, (3, 2, 2, places), dtype=torch.int8, generator=generator)
    queries = torch.randn(2, 3, 2, 2, generator=generator)
    q, d = torch.view_as_complex(queries), torch.complex(codes[:, :, 0] + 0.0, codes[:, :, 1] + 0.0)
    expected = torch.einsum("qkp,kpn->qnk", q, d.conj()).abs().sum(dim=-1)
    assert torch.allclose(code_scores(queries, codes), expected, rtol=1e-4)


def test_the_size_decides_which_search_it_is():
    database, queries = maps(50), maps(5, seed=3)
    index = index_of(database, SearchSettings(candidates=1, candidate_share=0, exhaustive_below=50))
    assert index.search(queries, k=4).place.shape == (5, 4)
    index.add(maps(1, seed=9))
    assert index.search(queries, k=4).place.shape == (5, 1)  # all that one candidate gives
    assert index.search(queries, k=4, exhaustive=True).place.shape == (5, 4)


@pytest.mark.parametrize("exhaustive", [True, False])
def test_later_places_can_be_left_out(exhaustive):
    database = maps(60)
    index = index_of(database, SearchSettings(candidates=60))
    found = index.search(database[40:41], 3, exhaustive=exhaustive, before=40)
    alone = index_of(database[:40], SearchSettings(candidates=60)).search(database[40:41], 3)
    assert torch.equal(found.place, alone.place)
    assert torch.allclose(found.score, alone.score, atol=1e-6)
    assert index.search(database[:1], 3, exhaustive=exhaustive, before=0).place.shape == (1, 0)


def test_places_added_one_by_one_are_those_added_at_once():
    database, queries = maps(70), maps(4, seed=2)
    whole, grown = index_of(database), CorrelationIndex(EXHAUSTIVE)
    for entry in database:
        grown.add(entry[None])
    assert len(grown) == 70
    assert torch.equal(grown.search(queries, 70).place, whole.search(queries, 70).place)


def test_of_equal_places_the_first_is_named():
    database = maps(1).expand(500, -1, -1)
    hits = index_of(database).search(database[:1], k=3)
    assert hits.place.tolist() == [[0, 1, 2]]


@pytest.mark.parametrize("precision", PRECISIONS)
def test_saved_and_opened_it_finds_the_same_and_grows(tmp_path, precision):
    database, queries = maps(30), maps(4, seed=2)
    index = index_of(
        database, SearchSettings(precision, CodeSettings(4, 4)), period=math.pi, cells=2
    )
    before = index.search(queries, 5)
    index.save(tmp_path / "map")
    opened = CorrelationIndex.open(tmp_path / "map")
    assert opened.settings == index.settings
    for held in (index, opened):
        after = held.search(queries, 5)
        assert torch.equal(after.place, before.place)
        assert torch.equal(after.score, before.score)
        assert torch.equal(after.turn, before.turn)
    first = (tmp_path / "map" / "00000.safetensors").read_bytes()
    opened.add(queries)
    opened.save(tmp_path / "map")
    assert (tmp_path / "map" / "00000.safetensors").read_bytes() == first
    again = CorrelationIndex.open(tmp_path / "map")
    assert len(again) == 34
    assert again.search(queries).place[:, 0].tolist() == [30, 31, 32, 33]
    assert again.search(queries, exhaustive=False).place[:, 0].tolist() == [30, 31, 32, 33]


def test_no_places_give_no_hits():
    hits = CorrelationIndex().search(maps(2), k=3)
    assert hits.place.shape == hits.score.shape == hits.turn.shape == (2, 0)


def test_mistakes_are_named(tmp_path):
    index = index_of(maps(5))
    with pytest.raises(DeepringError, match="12 x 6, but the places are 12 x 7"):
        index.search(maps(1, cols=6))
    with pytest.raises(DeepringError, match=r"expected descriptors \(n, θ, ω\)"):
        index.add(maps(5)[0])
    with pytest.raises(DeepringError, match="k: 0"):
        index.search(maps(1), k=0)
    with pytest.raises(DeepringError, match="stores no codes"):
        index.search(maps(1), exhaustive=False)
    with pytest.raises(DeepringError, match=r"search\.precision: 'float16'"):
        SearchSettings("float16")
    with pytest.raises(DeepringError, match=r"code\.components: 0"):
        CodeSettings(components=0)
    with pytest.raises(DeepringError, match=r"search\.candidates: 0"):
        SearchSettings(candidates=0)
    with pytest.raises(DeepringError, match=r"index\.safetensors: no such file"):
        CorrelationIndex.open(tmp_path)
    (tmp_path / "note.txt").write_text("mine")
    with pytest.raises(DeepringError, match="a folder with files"):
        index.save(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["note.txt"]


def test_damaged_files_are_named(tmp_path):
    index_of(maps(5)).save(tmp_path / "map")
    shard = tmp_path / "map" / "00000.safetensors"
    whole = shard.read_bytes()
    shard.write_bytes(whole[:-9])
    with pytest.raises(DeepringError, match=r"00000\.safetensors.*cut short"):
        CorrelationIndex.open(tmp_path / "map")
    shard.unlink()
    with pytest.raises(DeepringError, match=r"00000\.safetensors: no such file"):
        CorrelationIndex.open(tmp_path / "map")
    index_of(maps(4)).save(tmp_path / "other")
    shutil.copy(tmp_path / "other" / "00000.safetensors", shard)
    with pytest.raises(
        DeepringError, match=r"00000\.safetensors: from another .* shard 0 with 5 rows"
    ):
        CorrelationIndex.open(tmp_path / "map")


def grown(folder, *lots):
    """A folder with one shard per lot of places."""
    index = CorrelationIndex(SearchSettings("int8", CodeSettings(4, 4)))
    for lot in lots:
        index.add(lot)
        index.save(folder)
    return folder


def test_every_byte_of_shards_is_read_where_it_is_asked_for(tmp_path):
    folder = grown(tmp_path / "map", maps(5), maps(4, seed=1))
    CorrelationIndex.open(folder, check=True)
    shard = folder / "00001.safetensors"
    content = bytearray(shard.read_bytes())
    content[-1] ^= 1
    shard.write_bytes(content)
    CorrelationIndex.open(folder)
    with pytest.raises(FileError, match=r"^index shard .*00001\.safetensors: .* was altered"):
        CorrelationIndex.open(folder, check=True)


def test_shards_of_equal_shapes_cannot_change_places(tmp_path):
    folder = grown(tmp_path / "map", maps(5), maps(5, seed=1))
    first, second = (folder / f"0000{k}.safetensors" for k in (0, 1))
    content = first.read_bytes()
    first.write_bytes(second.read_bytes())
    second.write_bytes(content)
    with pytest.raises(FileError, match=r"00000\.safetensors: from another index or position"):
        CorrelationIndex.open(folder)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"period": "long"}, r"header\.period: 'long'"),
        ({"shape": [12]}, r"header\.shape: \[12\]"),
        ({"shape": [14, 7]}, "for descriptors of 14 x 7"),
        ({"shape": None}, "shape: missing"),
        ({"shards": [{"rows": 5}]}, "lacks digest"),
        ({"settings": {}}, r"header\.settings: lacks"),
        ({"lengths": [5]}, "header.lengths: unknown"),
        ({"period": 0.0}, r"period: 0\.0, expected a number above 0"),
        ({"period": 7.0}, r"period: 7\.0, expected a number of radians from 0"),
        ({"cells": -1.0}, r"cells: -1\.0"),
        ({"shape": [10**9, 7]}, "shape: 1000000000, expected at most"),
        ({"shape": [0, 7]}, "shape: 0, expected"),
    ],
)
def test_headers_that_no_index_has_are_refused(tmp_path, values, message):
    folder = grown(tmp_path / "map", maps(5))
    rewritten(folder / "index.safetensors", values=values)
    with pytest.raises(FileError, match=rf"^index .*index\.safetensors: .*{message}.*; build"):
        CorrelationIndex.open(folder)


@pytest.mark.parametrize("changes", [{"rows": 4}, {"rows": 10**15}, {"digest": "0"}])
def test_shards_that_disagree_with_the_index_are_refused(tmp_path, changes):
    folder = grown(tmp_path / "map", maps(5))
    (shard,) = parts_of(folder / "index.safetensors")[0]["values"]["shards"]
    rewritten(folder / "index.safetensors", values={"shards": [{**shard, **changes}]})
    with pytest.raises(FileError, match=r"00000\.safetensors: from another index or position"):
        CorrelationIndex.open(folder)


@pytest.mark.parametrize("name", ["basis", "step"])
def test_an_index_without_all_of_its_code_is_refused(tmp_path, name):
    folder = grown(tmp_path / "map", maps(5))
    rewritten(folder / "index.safetensors", lacking=[name])
    with pytest.raises(FileError, match=r"codes: .* without their basis or step"):
        CorrelationIndex.open(folder)


def test_a_map_built_place_by_place_gets_the_code_of_one_built_at_once():
    database, settings = maps(300, 20, 40), SearchSettings(code=CodeSettings(4, 8))
    slowly = index_of(database[:1], settings)
    first = slowly.code
    for place in database[1:]:
        slowly.add(place[None])
    at_once = fit_code(database[:256], settings.code)  # 1, 4, 16, 64, 256 places
    assert torch.allclose(slowly.code.step, at_once.step, rtol=1e-3)
    codes = torch.cat(codes_of(slowly), dim=-1)
    assert (codes - slowly.code.encode(database)).abs().max() <= 1, "all by the last code"
    assert (codes - first.encode(database)).abs().max() > 20


def test_places_taken_back_leave_the_code_that_was():
    database = maps(80, 20, 40)
    index = index_of(database[:10], SearchSettings(code=CodeSettings(4, 8)))
    mark, code, codes = index.mark(), index.code, torch.cat(codes_of(index), dim=-1)
    index.add(database[10:])
    assert not torch.equal(index.code.basis, code.basis)
    index.rewind(mark)
    assert index.code is code
    assert torch.equal(torch.cat(codes_of(index), dim=-1), codes)


def codes_of(index):
    return [block["code"] for block in index.places.blocks()]


@pytest.mark.parametrize("precision", ["float32", "bfloat16", "int8"])
def test_spectra_give_their_descriptors_back(precision):
    database = maps(5, 15, 7)
    again = decode(encode(database, precision), (15, 7))
    within = {"float32": 1e-6, "bfloat16": 0.02, "int8": 0.05}[precision]
    assert torch.allclose(again, database, atol=within * float(database.abs().max()))
