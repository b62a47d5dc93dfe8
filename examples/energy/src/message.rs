//! The message of the topic `energy`, and the state that survives the process.

use shared_types::wire::{Header, wire};

wire! {
    /// Energy and manipulability of the arm, from its estimated state.
    Energy on "energy" version 1 {
        /// Tick, incarnation, stamps.
        header: Header,
        /// Kinetic energy ½ q̇ᵀA(q)q̇; J.
        kinetic_j: f64,
        /// Potential energy in the field of gravity; J.
        potential_j: f64,
        /// Yoshikawa's manipulability √det(J Jᵀ); product of m and rad units of J's rows.
        manipulability: f64,
        /// Largest kinetic energy since the first tick; J.
        peak_kinetic_j: f64,
    }
}

wire! {
    /// The state of the process: all else follows from the message in hand.
    EnergyCheckpoint checkpoint version 1 {
        /// Largest kinetic energy since the first tick; J.
        peak_kinetic_j: f64,
    }
}
