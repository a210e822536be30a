"""Each format of a trajectory, read back by its own library: numbers, units, settings, bytes."""

from __future__ import annotations

import io
import json
import shutil
import subprocess
import sys
import time
from collections import defaultdict
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat

from pmjoint_codegen import ClosedLoop, Run
from pmjoint_codegen.errors import MissingToolError, UsageError
from pmjoint_codegen.logs import matlab, mcap
from pmjoint_codegen.logs.formats import FORMATS, available, save
from pmjoint_codegen.logs.trajectory import Column, Trajectory
from pmjoint_codegen.simulate.trajectory import trajectory_of

NAMES = [item.name for item in FORMATS]
AWKWARD = ("end", "_hidden", "q" * 70, "q" * 71, "units")  # what a model may call its states


@pytest.fixture(scope="module")
def run() -> Run:
    return ClosedLoop.load("paper").simulate(horizon=0.5, parameters={"c1": 20.0})


@pytest.fixture(scope="module")
def trajectory(run: Run) -> Trajectory:
    return trajectory_of(run)


@pytest.fixture(scope="module")
def folder(run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give a folder with the run in every format that can be written here."""
    made = tmp_path_factory.mktemp("logs")
    for item in FORMATS:
        if item.package not in sys.modules and item.package and not _there(item.package):
            continue
        run.save(made / f"run.{item.name}")
    return made


def _there(package: str) -> bool:
    try:
        import_module(package)
    except ImportError:
        return False
    return True


def awkward() -> Trajectory:
    """A trajectory with names and units that are hard for formats, and an end in infinities."""
    values = np.array([[0.0, 0.1, 0.2], *([[1.0 + k, -0.0, np.inf] for k in range(len(AWKWARD))])])
    columns = [Column("t", "s", "time", "output", values[0])]
    columns += [
        Column(name, "µV/°", f"state “{name[:6]}”", "plant", row)
        for name, row in zip(AWKWARD, values[1:], strict=True)
    ]
    return Trajectory(tuple(columns), "awkward", "", "00", "0", {"end": 1.5}, {"status": "diverged"})


def same(run: Run, found: dict[str, Any]) -> None:
    """Compare every column, bit by bit."""
    assert list(found) == [column.name for column in trajectory_of(run).columns]
    for name, values in found.items():
        assert np.asarray(values, dtype=float).tobytes() == np.ascontiguousarray(run[name]).tobytes(), name


def test_csv_is_the_numbers_and_nothing_else(run: Run, folder: Path) -> None:
    lines = (folder / "run.csv").read_text(encoding="ascii").splitlines()
    table = np.array([[float(text) for text in line.split(",")] for line in lines[1:]])
    same(run, dict(zip(lines[0].split(","), table.T, strict=True)))


def test_parquet_is_read_by_pyarrow_with_units_and_settings(run: Run, folder: Path) -> None:
    parquet: Any = pytest.importorskip("pyarrow.parquet")
    table = parquet.read_table(folder / "run.parquet")
    same(run, {name: table[name].to_numpy() for name in table.column_names})
    units = {field.name: field.metadata[b"unit"].decode() for field in table.schema}
    assert (units["t"], units["u"], units["x2"], units["Xi11"]) == ("s", "V", "rad/s", "rad s^2")
    assert table.schema.field("e").metadata[b"description"] == b"tracking error, e = z1 + r1"
    stated = {key.decode(): value.decode() for key, value in table.schema.metadata.items()}
    assert stated["model_hash"] == run.manifest.model_hash
    assert json.loads(stated["parameters"])["c1"] == 20.0
    assert json.loads(stated["summary"])["saturation_switches"] == run.summary["saturation_switches"]


def test_parquet_gives_pandas_the_units(run: Run, folder: Path) -> None:
    pytest.importorskip("pyarrow")
    pandas: Any = pytest.importorskip("pandas")
    frame = pandas.read_parquet(folder / "run.parquet")
    assert frame.attrs == run.to_dataframe().attrs


def test_mat_is_read_by_scipy_with_units_and_settings(run: Run, folder: Path) -> None:
    contents = loadmat(folder / "run.mat", simplify_cells=True)
    same(run, contents["trajectory"])
    assert list(contents["units"]) == list(contents["meanings"]) == list(contents["trajectory"])
    assert (contents["units"]["t"], contents["units"]["u"]) == ("s", "V")
    assert contents["meanings"]["e"] == "tracking error, e = z1 + r1"
    assert contents["run"]["model_hash"] == run.manifest.model_hash
    assert contents["run"]["parameters"]["c1"] == 20.0
    assert json.loads(contents["run"]["summary"])["peaks"] == {
        name: list(pair) for name, pair in run.summary["peaks"].items()
    }
    assert loadmat(folder / "run.mat")["trajectory"]["t"][0, 0].shape == (51, 1)  # a column


@pytest.fixture(scope="module")
def octave() -> str:
    found = shutil.which("octave-cli")
    return found or pytest.skip("GNU Octave is not installed: octave-cli")


def in_octave(octave: str, script: str) -> list[str]:
    """Run a script, and give the lines that it prints."""
    command = [octave, "--norc", "-q", "--eval", script]
    done = subprocess.run(command, check=True, capture_output=True, encoding="utf-8", timeout=60)
    return done.stdout.splitlines()


def test_mat_is_loaded_by_octave(run: Run, folder: Path, octave: str) -> None:
    names, *rows = in_octave(
        octave,
        f"s = load('{folder / 'run.mat'}'); c = struct2cell(s.trajectory); f = fieldnames(s.trajectory);"
        "printf('%s ', f{:}); disp(''); disp(strjoin(struct2cell(s.units)', ','));"
        "printf([repmat('%.17g ', 1, numel(c)) '\\n'], horzcat(c{:})');",
    )
    table = np.array([[float(text) for text in row.split()] for row in rows[1:]])
    same(run, dict(zip(names.split(), table.T, strict=True)))
    assert rows[0].split(",") == [column.unit for column in trajectory_of(run).columns]


def test_scipy_reads_text_beyond_ascii(tmp_path: Path) -> None:
    save(awkward, tmp_path / "awkward.mat")
    contents = loadmat(tmp_path / "awkward.mat", simplify_cells=True)
    assert list(contents["units"].values()) == ["s", *["µV/°"] * 5]
    assert contents["meanings"]["end_"] == "state “end”"
    assert contents["trajectory"]["end_"].tolist() == [1.0, -0.0, np.inf]
    assert contents["run"]["title"].size == 0


def test_octave_reads_awkward_names(tmp_path: Path, octave: str) -> None:
    save(awkward, tmp_path / "awkward.mat")
    lines = in_octave(
        octave,
        f"s = load('{tmp_path / 'awkward.mat'}'); f = fieldnames(s.trajectory)';"
        "for k = 1:numel(f) disp(f{k}), disp(isvarname(f{k})), end,"
        "disp(s.units.t), disp(s.trajectory.end_(3)), disp(s.run.parameters.end_)",
    )
    assert lines[:12:2] == ["t", "end_", "x_hidden", "q" * 63, "q" * 61 + "_2", "units"]
    assert lines[1:12:2] == ["1"] * 6
    assert lines[12:] == ["s", "Inf", "1.5000"]


def test_matlab_names_are_valid_and_different() -> None:
    given = ("a", "a b", "a_b", "1", "", *AWKWARD, *(f"{'q' * 63}{k}" for k in range(12)))
    found = matlab.names(given)
    assert len(set(found)) == len(given)
    assert all(name.isidentifier() and name.isascii() and name[0].isalpha() for name in found)
    assert all(len(name) <= 63 for name in found)
    assert "end" not in found
    assert matlab.names(["x1", "theta_dot"]) == ("x1", "theta_dot")


def test_a_run_too_long_for_mat_is_refused(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(matlab, "LARGEST", 51 * 8 * 22 - 1)
    with pytest.raises(UsageError, match=r"51 rows, more than .* longer output step"):
        run.save(tmp_path / "a.mat")
    assert list(tmp_path.iterdir()) == []


def read_mcap(path: Path) -> tuple[dict[str, Any], dict[str, list[tuple[int, dict[str, float]]]]]:
    """Give the schemas by topic and the messages by topic, in the file's order, with their log time."""
    reader: Any = pytest.importorskip("mcap.reader")
    schemas: dict[str, Any] = {}
    messages: dict[str, list[tuple[int, dict[str, float]]]] = defaultdict(list)
    with path.open("rb") as stream:
        for schema, channel, message in reader.make_reader(stream).iter_messages():
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            schemas[channel.topic] = json.loads(schema.data)
            assert message.sequence == len(messages[channel.topic])
            messages[channel.topic].append((message.log_time, json.loads(message.data)))
    return schemas, messages


def test_mcap_is_read_by_its_library_with_units(run: Run, folder: Path) -> None:
    schemas, messages = read_mcap(folder / "run.mcap")
    assert list(messages) == [
        *("/output", "/plant", "/filters", "/compensator"),
        *("/errors", "/input", "/estimate", "/disturbance"),
    ]
    found: dict[str, Any] = {}
    for topic, sent in messages.items():
        assert [stamp for stamp, _ in sent] == [10_000_000 * k for k in range(51)]
        columns = {name: [values[name] for _, values in sent] for name in sent[0][1]}
        assert columns["t"] == run.t.tolist()
        described = schemas[topic]["properties"]
        assert schemas[topic]["type"] == "object" and described.keys() == columns.keys()
        assert all(item["type"] == "number" for item in described.values())
        found |= columns
    order = [column.name for column in trajectory_of(run).columns]
    same(run, {name: found.pop(name) for name in order})
    assert found == {}
    assert schemas["/input"]["properties"]["u"]["unit"] == "V"
    assert schemas["/output"]["properties"]["e"]["description"] == "tracking error, e = z1 + r1 [rad]"


def test_mcap_can_be_searched_and_has_the_settings(run: Run, folder: Path) -> None:
    reader: Any = pytest.importorskip("mcap.reader")
    with (folder / "run.mcap").open("rb") as stream:
        opened = reader.make_reader(stream, validate_crcs=True)
        assert opened.get_summary().statistics.message_count == 8 * 51
        (record,) = opened.iter_metadata()
        (attached,) = opened.iter_attachments()
        inputs = list(opened.iter_messages(topics=["/input"]))
        assert [json.loads(message.data)["v"] for _, _, message in inputs] == run["v"].tolist()
    assert record.name == "run"
    assert record.metadata["model"] == "paper"
    assert record.metadata["model_hash"] == run.manifest.model_hash
    assert json.loads(record.metadata["parameters"])["c1"] == 20.0
    summary = json.loads(attached.data)
    assert attached.name == "summary.json"
    assert summary == json.loads(json.dumps({k: v for k, v in run.summary.items() if k != "wall_s"}))


def test_mcap_stamps_are_the_nearest_nanoseconds_in_every_block(
    run: Run, trajectory: Trajectory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("mcap")
    t = np.arange(51) / 3e7
    shifted = replace(trajectory, columns=(replace(trajectory.columns[0], values=t), *trajectory.columns[1:]))
    monkeypatch.setattr(mcap, "_ROWS", 20)
    save(lambda: shifted, tmp_path / "run.mcap")
    for sent in read_mcap(tmp_path / "run.mcap")[1].values():
        assert [stamp for stamp, _ in sent] == [(100 * k + 1) // 3 for k in range(51)]
        assert [values["t"] for _, values in sent] == t.tolist()
    inputs = [values["u"] for _, values in read_mcap(tmp_path / "run.mcap")[1]["/input"]]
    assert inputs == run["u"].tolist()


def test_mcap_leaves_out_what_json_cannot_say(tmp_path: Path) -> None:
    pytest.importorskip("mcap")
    save(awkward, tmp_path / "awkward.mcap")
    schemas, messages = read_mcap(tmp_path / "awkward.mcap")
    first, second, last = (values for _, values in messages["/plant"])
    assert first == {"t": 0.0, **{name: 1.0 + k for k, name in enumerate(AWKWARD)}}
    assert list(second) == ["t", *AWKWARD]
    assert last == {"t": 0.2}
    assert schemas["/plant"]["properties"]["end"]["unit"] == "µV/°"


@pytest.mark.parametrize("name", NAMES)
def test_the_same_run_has_the_same_bytes(
    name: str, run: Run, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not (folder / f"run.{name}").exists():
        pytest.skip(f"the package of {name} files is not installed")
    monkeypatch.setattr(time, "asctime", lambda *_: "Thu Jan  1 00:00:00 1970")
    again = ClosedLoop.load("paper").simulate(horizon=0.5, parameters={"c1": 20.0})
    assert again.wall_s != run.wall_s
    again.save(tmp_path / f"again.{name}")
    assert (tmp_path / f"again.{name}").read_bytes() == (folder / f"run.{name}").read_bytes()


@pytest.mark.parametrize("model", ["joint-lag", "third-order"])
def test_every_column_of_a_model_has_unit_meaning_and_group(model: str) -> None:
    made = trajectory_of(ClosedLoop.load(model).simulate(horizon=0.01))
    assert all(column.unit and column.about and column.group for column in made.columns)
    groups = {name: {column.name for column in columns} for name, columns in made.groups.items()}
    assert groups["input"] >= {"v", "u"} and groups["output"] >= {"y", "y_r", "e"}
    assert {column.group for column in made.columns if column.name.startswith("x_hat")} == {"estimate"}
    if model == "joint-lag":
        assert groups["plant"] >= {"x1", "x2", "theta", "theta_dot", "P1", "P2"}
    assert sum(map(len, groups.values())) == len(made.columns) - 1


def test_a_column_with_no_unit_is_a_pure_number(run: Run) -> None:
    states = tuple(replace(item, unit="") for item in run.manifest.states)
    changed = replace(run, manifest=replace(run.manifest, states=states))
    assert {column.unit for column in trajectory_of(changed).columns if column.name == "x1"} == {"1"}


@pytest.mark.parametrize(("package", "name"), [("pyarrow", "parquet"), ("mcap", "mcap")])
def test_an_absent_package_is_named_with_what_installs_it(
    package: str, name: str, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(MissingToolError, match=rf"^{package} is needed .*pmjoint-codegen\[logs\]") as caught:
        run.save(tmp_path / f"run.{name}")
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("name", "said"), [("run.parquett", "did you mean 'parquet'"), ("run", "is ''")])
def test_an_unknown_ending_is_refused_with_those_that_are_known(
    name: str, said: str, run: Run, tmp_path: Path
) -> None:
    with pytest.raises(UsageError, match=r"allowed: csv, parquet, mat, mcap") as caught:
        run.save(tmp_path / name)
    assert said in str(caught.value)


def test_a_file_appears_whole_or_not_at_all(
    trajectory: Trajectory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("mcap")
    path = tmp_path / "run.mcap"
    path.write_bytes(b"the run before")

    def interrupted(t: float, *_: object) -> bytes:
        if t > 0.3:
            raise KeyboardInterrupt
        return b"{}"

    monkeypatch.setattr(mcap, "_message", interrupted)
    with pytest.raises(KeyboardInterrupt):
        save(lambda: trajectory, path)
    assert path.read_bytes() == b"the run before"
    assert list(tmp_path.iterdir()) == [path]


def test_every_row_of_the_table_has_its_writer(trajectory: Trajectory) -> None:
    for item in FORMATS:
        if not item.package or _there(item.package):
            assert available(item.name, "here") is item
            stream = io.BytesIO()
            import_module(item.module).write(trajectory, stream)
            assert len(stream.getvalue()) > 51 * 8
