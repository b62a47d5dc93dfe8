//! A run as other programs read it: pyarrow, polars, DuckDB, mcap, Rerun. Each part is skipped, and says so, where Python has no such module.

use crate::command::{Desk, has_python, lacks, skipped, source};

const SHORT: &str = "--set segment.0.duration_s=1 --set segment.1.duration_s=1.5 --out results";

/// Runs Python in the desk's folder, where it must print `good`.
pub(crate) fn python(desk: &Desk, code: &str) {
    let mut python = desk.program("python3");
    let said = python.args(["-c", code]).env("RUST_LOG", "error").output();
    let said = said.expect("python3 runs");
    let [out, err] = [&said.stdout, &said.stderr].map(|text| String::from_utf8_lossy(text));
    assert!(out.ends_with("good\n"), "{out}\n{err}");
}

/// The same where it has a module.
fn python_with(module: &str, desk: &Desk, code: &str) {
    if has_python(module) {
        python(desk, code);
    } else {
        skipped(format!("python3 has no {module}"));
    }
}

fn export(desk: &Desk, format: &str) {
    let said = desk.succeeds(&format!("export results --format {format}"));
    assert_eq!(said.err.as_str(), "");
}

#[test]
fn tables_have_units_and_what_researchers_ask_for() {
    if lacks("numpy, pyarrow") {
        return;
    }
    let desk = Desk::new();
    desk.run(SHORT);
    export(&desk, "parquet");
    export(&desk, "csv");
    python(
        &desk,
        r#"
import csv, json
import numpy as np, pyarrow as pa, pyarrow.parquet as pq

ticks = json.load(open("results/summary.json"))["ticks"]
table, file = pq.read_table("results/signals.parquet"), pq.ParquetFile("results/signals.parquet")
assert table.num_rows == ticks and file.metadata.row_group(0).column(3).compression == "ZSTD"
assert table.schema.metadata[b"scenario"] == b"fig5-wrist-rotation" and table.schema.metadata[b"rate_hz"] == b"1000"
unit = {field.name: field.metadata[b"unit"].decode() for field in table.schema}
assert (unit["t_s"], unit["joint.q.1"], unit["torque.applied.6"], unit["hand.position.x"]) == ("s", "rad", "N*m", "m")
assert (unit["hand.angular_velocity.z"], unit["error.orientation_deg.along"], unit["latency.us.hop_sensor"]) == ("rad/s", "deg", "us")
assert unit["singularity.zeta.wrist.wx"] == "1"
assert all(name.isascii() for name in table.column_names), table.column_names

def of(name, elements):
    return np.stack([table[f"{name}.{element}"].to_numpy() for element in elements], axis=1)

joints = "123456"
for name in ("hand", "desired"):
    p, x, v, w = of(f"{name}.position", "xyz"), of(f"{name}.orientation", "xyzw"), of(f"{name}.velocity", "xyz"), of(f"{name}.angular_velocity", "xyz")
    assert np.abs(np.linalg.norm(x, axis=1) - 1).max() < 1e-9 and (np.sum(x[1:] * x[:-1], axis=1) > 0.9).all(), "unit, of continuous sign"
    assert np.abs(np.gradient(p, 1e-3, axis=0)[5:-5] - v[5:-5]).max() < 2e-3 * max(1, np.abs(v).max()), f"{name}: velocity"
    # ẋ = ½ ω ⊗ x, with w last.
    (a, b, c, d), (i, j, k) = x.T, w.T
    turned = 0.5 * np.stack([i*d + j*c - k*b, j*d + k*a - i*c, k*d + i*b - j*a, -i*a - j*b - k*c], axis=1)
    assert np.abs(np.gradient(x, 1e-3, axis=0)[5:-5] - turned[5:-5]).max() < 5e-3, f"{name}: angular velocity"
assert np.abs(of("hand.position", "xyz") - of("desired.position", "xyz")).max() < 1e-3
assert np.abs(of("joint.q_encoder", joints) - of("joint.q", joints)).max() < 1e-3
assert np.abs(of("joint.q_estimate", joints) - of("joint.q", joints)).max() < 1e-3
assert np.array_equal(of("torque.applied", joints)[1:], of("torque.commanded", joints)[:-1]), "a torque acts from its tick to the next"
zeta, inside = of("singularity.zeta.wrist", ["vx", "vy", "vz", "wx", "wy", "wz"]), table["singularity.inside.wrist"].to_numpy()
assert np.abs(np.linalg.norm(zeta, axis=1) - 1).max() < 1e-9 and np.abs(zeta[:, :3]).max() == 0 and set(inside) == {0.0, 1.0}

with open("results/signals.csv") as file:
    rows = list(csv.DictReader(file))
assert list(rows[0]) == table.column_names and len(rows) == ticks
for name in table.column_names:
    column = table[name]
    if pa.types.is_float32(column.type) or name == "tick":
        continue
    read = [float(row[name]) if row[name] else None for row in rows]
    assert read == column.to_pylist(), name
print("good")
"#,
    );
    let code = "import polars as pl\nt = pl.read_parquet('results/signals.parquet')\nassert t['tick'].is_sorted() and t['hand.position.z'].null_count() == 0\n\
                e = pl.read_parquet('results/events.parquet')\nassert len(e.filter(pl.col('subject') == 'mode/wrist')) >= 2\nprint('good')";
    python_with("polars", &desk, code);
    let code = "import duckdb, json\nn, z = duckdb.sql(\"select count(*), max(\\\"hand.position.z\\\") from 'results/signals.parquet'\").fetchall()[0]\n\
                assert n == json.load(open('results/summary.json'))['ticks'] and 0 < z < 2\nprint('good')";
    python_with("duckdb", &desk, code);
}

#[test]
fn messages_are_read_as_ros_2_reads_them() {
    let desk = Desk::new();
    desk.run(SHORT);
    export(&desk, "csv");
    let table = r#"
import csv, json
summary = json.load(open("results/summary.json"))
counts = {f"/{topic}": one["count"] for topic, one in summary["topics"].items()}
with open("results/signals.csv") as file:
    rows = list(csv.DictReader(file))
def check(found):
    assert {topic: len(messages) for topic, messages in found.items()} == counts
    for tick, (row, (time, torque)) in enumerate(zip(rows, found["/torque"])):
        assert (torque.header.tick, time) == (tick, tick * 10**6)
        assert [float(row[f"torque.commanded.{i + 1}"]) for i in range(6)] == list(torque.tau)[:6]
    (_, report), row = found["/singularity"][-1], rows[-1]
    kinds = ["vx", "vy", "vz", "wx", "wy", "wz"]
    zeta = [float(row[f"singularity.zeta.wrist.{kind}"]) for kind in kinds]
    assert zeta in [list(one.zeta_b) for one in report.singularities]
"#;
    let mcap = r#"
from mcap_ros2.reader import read_ros2_messages
found = {}
for one in read_ros2_messages("results/messages.mcap"):
    found.setdefault(one.channel.topic, []).append((one.log_time_ns, one.ros_msg))
check(found)
print("good")"#;
    python_with("mcap_ros2", &desk, &[table, mcap].concat());
    let rosbags = r#"
from pathlib import Path
from rosbags.rosbag2.storage_mcap import McapReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
store, found = get_typestore(Stores.EMPTY), {}
bag = McapReader(Path("results/messages.mcap"))
bag.open()
for one in bag.connections:
    store.register(get_types_from_msg(one.msgdef.data, one.msgtype))
for one, time, data in bag.messages(bag.connections, None, None):
    found.setdefault(one.topic, []).append((time, store.deserialize_cdr(data, one.msgtype)))
check(found)
print("good")"#;
    python_with("rosbags.highlevel", &desk, &[table, rosbags].concat());
}

#[test]
fn a_recording_is_read_as_its_page_says() {
    if lacks("rerun.server, pandas, datafusion") {
        return;
    }
    let desk = Desk::new();
    desk.run(SHORT);
    let check = "import json\nticks = json.load(open('results/summary.json'))['ticks']\ntable = load('results')\n\
                 assert list(table['tick']) == list(range(ticks)), len(table)\nassert (table['/signals:joint:q'].str.len() == 6).all()\nprint('good')";
    // Behind the first program of the page.
    let page = source("docs/recording.md");
    let (_, program) = page.split_once("```python\n").expect("a program");
    let (program, _) = program.split_once("```").expect("its end");
    python(&desk, &[program, "\n", check].concat());
    let mut verify = desk.program("rerun");
    let Ok(said) = verify.args(["rrd", "verify", "results/run.rrd"]).output() else {
        return skipped("there is no `rerun`");
    };
    let err = String::from_utf8_lossy(&said.stderr);
    assert!(said.status.success(), "{err}");
}
