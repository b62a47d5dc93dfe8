//! A run as other programs read it: pyarrow, polars, DuckDB, mcap, Rerun. Each part is skipped, and says so, where Python has no such module.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::command::{Desk, skipped};
use crate::exchange::has_python;

const SHORT: [&str; 6] = [
    "--set",
    "segment.0.duration_s=1",
    "--set",
    "segment.1.duration_s=1.5",
    "--out",
    "results",
];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Runs Python in the desk's folder, where it must print `good`.
fn python(desk: &Desk, code: &str) {
    let mut command = Command::new("python3");
    command
        .args(["-c", code])
        .current_dir(desk.path())
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .env("RUST_LOG", "error");
    let said = command
        .env("ARMPLANE", env!("CARGO_BIN_EXE_armplane"))
        .env("PYTHONPATH", root().join("python"))
        .output()
        .expect("python3 runs");
    let (out, err) = (
        String::from_utf8_lossy(&said.stdout),
        String::from_utf8_lossy(&said.stderr),
    );
    assert!(out.ends_with("good\n"), "{out}\n{err}");
}

fn export(desk: &Desk, format: &str) {
    let said = desk.armplane(&["export", "results", "--format", format]);
    assert_eq!((said.code, said.err.as_str()), (0, ""));
}

#[test]
fn tables_have_units_and_what_researchers_ask_for() {
    if !has_python("numpy, pyarrow") {
        return skipped("python3 has no numpy and pyarrow, or there is none");
    }
    let desk = Desk::new();
    desk.run(&SHORT);
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
assert json.loads(file.metadata.metadata[b"armplane:columns"])["singularity.zeta.wrist.wx"]["unit"] == "1"
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
    if has_python("polars") {
        let code = "import polars as pl\nt = pl.read_parquet('results/signals.parquet')\nassert t['tick'].is_sorted() and t['hand.position.z'].null_count() == 0\n\
                    e = pl.read_parquet('results/events.parquet')\nassert len(e.filter(pl.col('subject') == 'mode/wrist')) >= 2\nprint('good')";
        python(&desk, code);
    } else {
        skipped("python3 has no polars");
    }
    if has_python("duckdb") {
        let code = "import duckdb, json\nn, z = duckdb.sql(\"select count(*), max(\\\"hand.position.z\\\") from 'results/signals.parquet'\").fetchall()[0]\n\
                    assert n == json.load(open('results/summary.json'))['ticks'] and 0 < z < 2\n\
                    q = \"select decode(value) from parquet_kv_metadata('results/signals.parquet') where decode(key) = 'armplane:columns'\"\n\
                    assert json.loads(duckdb.sql(q).fetchall()[0][0])['joint.qdot.1'] == {'unit': 'rad/s', 'description': 'Joint velocities; rad/s.'}\nprint('good')";
        python(&desk, code);
    } else {
        skipped("python3 has no duckdb");
    }
}

#[test]
fn foxglove_gets_the_arm_in_three_dimensions() {
    if !has_python("numpy, mcap") {
        return skipped("python3 has no numpy and mcap, or there is none");
    }
    let desk = Desk::new();
    desk.run(&SHORT);
    export(&desk, "mcap");
    python(
        &desk,
        r#"
import json
import numpy as np
from mcap.reader import make_reader

messages, schemas = {}, {}
with open("results/run.mcap", "rb") as file:
    for schema, channel, message in make_reader(file).iter_messages():
        assert channel.message_encoding == "json" and schema.encoding == "jsonschema" and json.loads(schema.data)["type"] == "object"
        schemas[channel.topic] = schema.name
        messages.setdefault(channel.topic, []).append((message.log_time, json.loads(message.data)))
assert schemas["/tf"] == "foxglove.FrameTransform" and schemas["/arm"] == schemas["/zeta"] == "foxglove.SceneUpdate"
assert schemas["/pose/hand"] == schemas["/pose/desired"] == "foxglove.PoseInFrame" and schemas["/log"] == "foxglove.Log"

solids = [entity for _, update in messages["/arm"] for entity in update["entities"]]
assert [solid["frame_id"] for solid in solids] == ["base"] + [f"link{i}" for i in range(1, 7)]
for solid in solids:
    (mesh,) = solid["triangles"]
    assert len(mesh["indices"]) % 3 == 0 and max(mesh["indices"]) < len(mesh["points"]) > 50 and len(mesh["colors"]) in (0, len(mesh["points"]))
    assert solid["frame_locked"] and solid["lifetime"] == {"sec": 0, "nsec": 0}

frames = {}
for at, tf in messages["/tf"]:
    assert tf["parent_frame_id"] == "base" and at == tf["timestamp"]["sec"] * 10**9 + tf["timestamp"]["nsec"]
    x = [tf["rotation"][k] for k in "xyzw"]
    assert abs(np.linalg.norm(x) - 1) < 1e-5
    frames.setdefault(tf["child_frame_id"], {})[at] = ([tf["translation"][k] for k in "xyz"], x)
assert {"link1", "link6", "hand", "desired", "singularity_wrist"} <= set(frames) and len(frames["link6"]) > 50
hand = dict(messages["/hand"])
for at, (p, x) in frames["hand"].items():
    assert np.abs(np.array(p) - hand[at]["position"]).max() < 1e-6, at
    assert abs(abs(np.dot(x, hand[at]["orientation"])) - 1) < 1e-6, at
arrows = [entity for _, update in messages["/zeta"] for entity in update["entities"] if entity["id"] == "wrist"]
assert len(arrows) > 50 and all(len(entity["arrows"]) == 2 and entity["lifetime"]["nsec"] > 0 for entity in arrows)
print("good")
"#,
    );
}

/// The first Python program of a page.
fn program(page: &str) -> String {
    let text = std::fs::read_to_string(root().join("docs").join(page)).expect("the page");
    let (_, from) = text.split_once("```python\n").expect("a program");
    from.split_once("```").expect("its end").0.to_owned()
}

/// `rerun`, where Python's package brings it.
fn rerun() -> Option<PathBuf> {
    let found = Command::new("python3")
        .args(["-c", "import shutil; print(shutil.which('rerun') or '')"])
        .output()
        .ok()?;
    Some(PathBuf::from(String::from_utf8_lossy(&found.stdout).trim())).filter(|path| path.is_file())
}

#[test]
fn a_recording_of_several_parts_reads_as_one() {
    if !has_python("rerun.server, pandas, datafusion") {
        return skipped("python3 has no rerun-sdk[dataplatform] and pandas, or there is none");
    }
    let desk = Desk::new();
    // Parts by length, and a recorder that is killed.
    desk.file(
        "killed.toml",
        "name = \"killed\"\nrobot = \"puma560\"\n[record]\npart_s = 0.8\n[start]\nq_deg = [20, -60, 170, 0, 30, 0]\n[[segment]]\nby_m = [0.1, 0, 0]\n\
         duration_s = 1.5\n[[fault]]\nprocess = \"recorder\"\nkind = \"kill\"\nat_s = 1.2\n",
    );
    let summary = desk.run(&["killed.toml", "--out", "results"]);
    assert_eq!(summary["recorder"]["parts"], 4);
    export(&desk, "rrd");
    let check = "import json\nticks = json.load(open('results/summary.json'))['ticks']\ntable = load('results')\n\
                 assert list(table['tick']) == list(range(ticks)), len(table)\nassert (table['/signals:joint:q'].str.len() == 6).all()\n\
                 import os\nos.mkdir('one')\nos.rename('results/whole.rrd', 'one/run.rrd')\none = load('one')\n\
                 assert list(one['tick']) == list(range(ticks)) and set(one.columns) == set(table.columns)\n\
                 assert (one['/signals:joint:q'].map(list) == table['/signals:joint:q'].map(list)).all()\nprint('good')";
    python(&desk, &format!("{}\n{check}", program("recording.md")));
    let Some(rerun) = rerun() else {
        return skipped("there is no `rerun` beside python3");
    };
    for file in [
        "results/run.rrd",
        "results/run-001.rrd",
        "results/run-002.rrd",
        "results/run-003.rrd",
        "one/run.rrd",
    ] {
        let said = Command::new(&rerun)
            .args(["rrd", "verify", file])
            .current_dir(desk.path())
            .output()
            .expect("rerun starts");
        assert!(
            said.status.success(),
            "{file}: {}",
            String::from_utf8_lossy(&said.stderr)
        );
    }
}
