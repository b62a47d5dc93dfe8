//! Units of keys and columns, by their names.

/// A unit at the end of a name, and how it is written.
const SUFFIXES: [(&str, &str); 12] = [
    ("_deg", "°"),
    ("_rad", "rad"),
    ("_mm", "mm"),
    ("_m", "m"),
    ("_kg", "kg"),
    ("_s", "s"),
    ("_ms", "ms"),
    ("_hz", "1/s"),
    ("_nm", "N·m"),
    ("_j", "J"),
    ("_ticks", "ticks"),
    ("_counts", "counts"),
];

/// Units of names that do not end in one.
const UNITS: [(&str, &str); 16] = [
    ("control.k_p", "1/s²"),
    ("control.k_v", "1/s"),
    ("control.k_vq", "1/s"),
    ("control.k_aux", "1/s"),
    ("control.aux_rate_max", "rad/s"),
    ("control.aux_slew", "rad/s²"),
    ("control.baseline.hold_and_blend.hold_k_p", "1/s²"),
    ("control.baseline.hold_and_blend.hold_k_v", "1/s"),
    ("control.baseline.hold_and_blend.push_k_v", "1/s"),
    ("plant.encoder_bits", "bits"),
    ("plant.mass_factor", "1"),
    ("estimator.bandwidth", "rad/s"),
    ("estimator.disturbance_bandwidth", "rad/s"),
    ("time_stretch", "1"),
    ("s_min", "1"),
    ("ticks", "ticks"),
];

/// Spellings of one unit.
const SPELLINGS: [(&str, &str); 9] = [
    ("deg", "°"),
    ("1/s^2", "1/s²"),
    ("s⁻²", "1/s²"),
    ("Hz", "1/s"),
    ("s⁻¹", "1/s"),
    ("Nm", "N·m"),
    ("rad/s^2", "rad/s²"),
    ("-", "1"),
    ("", "1"),
];

/// Whether `inner` is `outer` or a part of it: `start.q_deg.4` of `start.q_deg`.
pub(super) fn is_within(inner: &str, outer: &str) -> bool {
    let rest = inner.strip_prefix(outer);
    rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
}

/// The unit that a key or a column has by its name.
pub(super) fn unit_of(name: &str) -> Option<&'static str> {
    if let Some((_, unit)) = UNITS.iter().find(|(known, _)| is_within(name, known)) {
        return Some(unit);
    }
    let is_word = |part: &&str| part.parse::<usize>().is_err();
    let word = name.split('.').rfind(is_word)?;
    if word.ends_with("_ratio") {
        return Some("1");
    }
    let found = SUFFIXES.iter().find(|(suffix, _)| word.ends_with(suffix));
    found.map(|(_, unit)| *unit)
}

/// A name with its unit, where the name does not end in it.
pub(super) fn titled(name: &str) -> String {
    let is_in_name = SUFFIXES.iter().any(|(suffix, _)| name.ends_with(suffix));
    match unit_of(name) {
        Some(unit) if unit != "1" && !is_in_name => format!("{name}, {unit}"),
        _ => name.to_owned(),
    }
}

/// One spelling for each unit.
pub(super) fn spelt(unit: &str) -> &str {
    let known = SPELLINGS.iter().find(|(other, _)| *other == unit);
    known.map_or(unit, |(_, unit)| *unit)
}
