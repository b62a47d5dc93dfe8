//! Steered runs: random twists, and the state of a session in words.

use shared_types::ServoState;
use shared_types::codes::{
    REASON_OVER, REASON_RESTING, REASON_STALE, REFUSALS, name_of, reason_text, singularity_name,
};
use shared_types::random::Uniform;

/// Seeded random twists as a text of targets: every 1 to 3 s another direction, up to 0.25 m/s and 0.6 rad/s, at times one of the two alone.
pub fn twists(seed: u64, seconds: f64) -> String {
    let mut random = Uniform(seed);
    let mut text = "# armplane targets 1, length m\n".to_owned();
    let mut time = 0.0;
    while time < seconds {
        let lasts = random.within(1.0, 3.0).min(seconds - time);
        let mut direction = |most: f64| {
            let v: [f64; 3] = std::array::from_fn(|_| random.within(-1.0, 1.0));
            let size = v.iter().map(|x| x * x).sum::<f64>().sqrt().max(1e-3);
            let speed = random.within(0.2, 1.0) * most;
            v.map(|x| x / size * speed)
        };
        let (linear, angular) = (direction(0.25), direction(0.6));
        let kind = random.within(0.0, 4.0);
        let values = linear
            .map(|x| if kind < 1.0 { 0.0 } else { x })
            .into_iter()
            .chain(angular.map(|x| if kind > 3.0 { 0.0 } else { x }));
        let values: Vec<String> = values.map(|x| format!("{x:.4}")).collect();
        text += &format!("{time:.3}, twist, base, {lasts:.3}, {}\n", values.join(" "));
        time += lasts;
    }
    text + &format!("{seconds:.3}, end\n")
}

/// The state of a session as one line; `kind` gives the kind of the singularity in a place, by which it is called.
pub fn describe(state: &ServoState, kind: impl Fn(usize) -> Option<u32>) -> String {
    let mut text = reason_text(state.reason, state.joint, state.upper).to_string();
    if ![REASON_RESTING, REASON_STALE, REASON_OVER].contains(&state.reason) {
        text += &format!("; speed {:.0} %", state.speed_scale * 100.0);
    }
    let place = (state.singularity as usize).checked_sub(1);
    if let Some(place) = place
        && let Some(kind) = kind(place)
        && state.nearest < 1e8
    {
        text += &format!(
            "; {} at {:.2} of its bound",
            singularity_name(kind, place),
            state.nearest
        );
    }
    if state.stops > 0 {
        text += &format!(
            "; {} × stopped: {}",
            state.stops,
            name_of(REFUSALS, state.stop)
        );
    }
    text
}
