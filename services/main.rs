//! Drives robot arms through their kinematic singularities, by the strategy of Chang and Khatib (1995).
//!
//! `armplane` is one executable. `armplane run` starts itself once per process of the graph, and
//! these processes exchange messages of fixed size in shared memory:
//!
//! ```text
//! plant ──sensor──► estimator ──estimate──┬──► controller ──torque──► plant
//!   │                                     └──► analyzer ──singularity──┘
//!   └─plant_state (truth, for judging)        every topic ──► recorder ──► messages.mcap, summary.json
//! ```
//!
//! # Where to begin
//!
//! | to use or change | start at |
//! |---|---|
//! | the control law | [`control`](../control/index.html): one tick is six calls, in `tick.rs` |
//! | kinematics and dynamics of an arm | [`model`](../model/index.html) |
//! | scenarios, graphs, messages, results | [`shared_types`](../shared_types/index.html) |
//! | one process | [`plant`](../plant/index.html), [`estimator`](../estimator/index.html), [`analyzer`](../analyzer/index.html), [`controller`](../controller/index.html), [`recorder`](../recorder/index.html); of a steered run [`operator`](../operator/index.html), of a Franka arm `plant-fci` |
//! | a process as a step, faults of its messages | [`process`](../process/index.html); all steps on one thread: [`chain`](../chain/index.html) |
//! | topics, waits, faults | [`runtime`](../runtime/index.html) |
//! | a run as a library | [`session`](../session/index.html), which plans it, and [`launcher`](../launcher/index.html), which starts and watches it |
//! | trials, comparisons, proofs | [`lab`](../lab/index.html), seeded [`lines`](../lines/index.html) |
//! | the command line | [`cli`](../cli/index.html) |
//! | the arm and its law, or a process, for other languages | `arm`, `python`, `capi`, `capi-process` |
//! | bounded files and lines | [`files`](../files/index.html) |
//! | the simulated arm, scenarios | [`sim`](../sim/index.html) |
//! | recordings and reports | [`viz`](../viz/index.html) |
//!
//! Three crates are made for other programs: `armplane-types`, `armplane-model` and
//! `armplane-control`. `docs/architecture.md` lists the rules between the crates, and
//! `docs/tutorial.md` shows the program.

fn main() -> std::process::ExitCode {
    cli::main()
}
