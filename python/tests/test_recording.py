"""Recordings, tables and the programs that read them."""

from __future__ import annotations

import deltatwin as dt
import numpy as np
import pytest


def test_arrays_come_back(runs, tmp_path):
    recording = runs[0]
    again = dt.Recording.from_arrays(recording.t, recording.q, recording.tau, setup=recording.setup)
    for own, other in ((again.t, recording.t), (again.q, recording.q), (again.tau, recording.tau)):
        np.testing.assert_array_equal(own, other)
    for name in ("run.csv", "run.mcap"):
        file = tmp_path / name
        recording.write(file)
        read = dt.Recording.read(file, model=dt.Model.builtin("irb360-6-1600"))
        np.testing.assert_array_equal(read.q, recording.q)
        np.testing.assert_array_equal(read.tau, recording.tau)
        with pytest.raises(FileExistsError):
            recording.write(file)


def test_errors_of_data_have_a_place(tmp_path):
    with pytest.raises(dt.DataError) as caught:
        dt.Recording.from_arrays([0.0, 0.1, 0.2], np.zeros((3, 4)), [[0] * 4, [0, np.nan, 0, 0], [0] * 4])
    assert (caught.value.row, caught.value.column) == ("1", "tau2")
    with pytest.raises(dt.DataError, match="row 2, column `t`"):
        dt.Recording.from_arrays([0.0, 0.1, 0.1], np.zeros((3, 4)), np.zeros((3, 4)))
    file = tmp_path / "run.csv"
    file.write_text("t,q1,tau1\n0,0,0\n0.001,nonsense,0\n0.002,0,0\n")
    with pytest.raises(dt.DataError) as caught:
        dt.Recording.read(file)
    assert caught.value.path == str(file) and caught.value.column == "q1" and "3" in str(caught.value.row)


def test_payload_and_setup():
    payload = dt.Payload(2.0, [0.01, 0, -0.1], inertia_zz=0.02)
    setup = dt.Setup(payload, torque_noise=[0.5, 0.5, 0.5, 0.05])
    assert setup.payload == payload and setup.torque_noise == [0.5, 0.5, 0.5, 0.05]
    # A box of 6 kg, 0.4 × 0.3 × 0.2 m: Θ_xx = 6/12·(0.3² + 0.2²) = 0.065 kg·m².
    assert dt.Payload.cuboid([0.4, 0.3, 0.2], 6.0).inertia[0] == pytest.approx(0.065, abs=1e-15)
    with pytest.raises(ValueError, match="triangle"):
        dt.Payload(1.0, inertia=[0.01, 0.01, 0.03])
    with pytest.raises(ValueError):
        dt.Payload(-1.0)


def test_tables_are_read_by_polars_pandas_arrow_duckdb(runs):
    recording = runs[0]
    polars = pytest.importorskip("polars")
    frame = polars.DataFrame(recording)
    assert frame.columns[:5] == ["t", "q1", "q2", "q3", "q4"]
    np.testing.assert_array_equal(frame["tau2"].to_numpy(), recording.tau[:, 1])
    arrow = pytest.importorskip("pyarrow")
    table = arrow.table(recording)
    assert table.num_rows == len(recording)
    assert table.schema.field("q1").metadata[b"unit"] == b"rad"
    pandas = pytest.importorskip("pandas")
    np.testing.assert_array_equal(pandas.DataFrame.from_arrow(recording.to_arrow())["q1"], recording.q[:, 0])
    duckdb = pytest.importorskip("duckdb")
    samples = recording.to_arrow()  # noqa: F841, DuckDB finds it by its name
    (count, largest), = duckdb.sql("select count(*), max(tau1) from samples").fetchall()
    assert (count, largest) == (len(recording), recording.tau[:, 0].max())


def test_a_table_alone(model):
    table = model.parameters
    assert table.names == ["name", "value", "unit", "role", "low", "high"] and len(table) == len(table["name"])
    with pytest.raises(KeyError, match="expected one of name, value"):
        table["nmae"]
    assert table._repr_html_().startswith("<table>")


def test_a_recording_in_rerun(runs, model, tmp_path):
    pytest.importorskip("rerun")
    file = tmp_path / "run.rrd"
    dt.to_rerun(runs[0], model, file)
    assert file.read_bytes()[:4] == b"RRF2" and file.stat().st_size > 100_000
