//! Singular directions of any arm, by number: the smallest singular directions of the unit-scaled Jacobian, tracked from tick to tick.
//!
//! # Measure
//! J has R rows and N ≥ R columns, those of absent joints apart. At a singular posture u is the left null vector of the unit-scaled J, and the joint
//! motions that the other directions leave free span Π, of dimension d = N − R + 1. Near by, uᵀJ = mᵀ with m in Π.
//!
//! - Without spare joints d is 1: m = σv, and s = σ/σ_ref is signed. It crosses zero in a straight line where the smallest singular value has a kink.
//! - With spare joints most singularities have codimension d ≥ 2: m = 0 is d conditions, which a path misses, or passes at a distance of |m|. The
//!   measure is the vector m, and s = |m|/σ_ref ≥ 0.
//!
//! σ_ref is the smallest singular value in the most regular of a fixed set of postures: s is about ±1 in the arm's best posture, as sin θ is at an elbow.
//!
//! # Directions
//! u is part translation, part rotation. ζ is the larger half, made a unit vector: eliminating the rotation's row, not the singular vector's, keeps
//! translation exact. Modulo the kept rows ζᵀJ = mᵀ/|u_ω| (or mᵀL/|u_v|). Where the last three axes meet in a wrist, J at that point is block triangular,
//! and each block is decomposed by itself, so a metre never meets a radian.
//!
//! # Auxiliary row
//! m may turn by half a turn around the singular posture within a few ticks, so no auxiliary row follows it there. The row is a unit vector a in Π that
//! is carried from tick to tick without turning in Π (module [`auxiliary_row`](super::auxiliary_row)); where d is 1 it is ±v.
//!
//! # Places
//! A direction is reported where its name belongs. The name is that of the singular posture to which Newton's method leads it, looked up when |s| falls
//! below 1.3 η_out; beyond that a place may pass from one direction to another, and s of a place is continuous only up to there.

use super::auxiliary_row::{Turn, UNDEFINED};
use super::axes::frame;
use super::classify::{Lock, Verdict, classify};
use super::family::Posture;
use super::geometry::Geometry;
use super::screws::Screws;
use super::tracked_svd::{SQUARED_GAP, TrackedSvd};
use crate::linear::{
    Basis, Joints, Matrix3, Vector3, Vector6, angular, half_of, halves, linear, smoothstep, stack,
    unit,
};
use crate::paper::neighborhood::Neighborhood;
use crate::paper::type_2::TURNS;
use crate::types::{Class, Kind, Singularity};
use model::{joints, padded};
use nalgebra::SMatrix;
use shared_types::checkpoints::PlaceCheckpoint;
use shared_types::random::Uniform;
use shared_types::scenario::{Analysis, BySingularity};
use shared_types::{AnalyzerCheckpoint, MAX_SINGULARITIES};
use std::f64::consts::PI;

/// Directions with a vector measure that are tracked at once: the smallest ones.
pub(super) const TRACKED: usize = 3;

/// s is never exactly zero: its sign is the side.
pub(super) const SMALLEST: f64 = 1e-12;

/// |s| over η_out below which a direction is classified, and beyond which its type is given up: a hysteresis outside of the neighbourhood.
const LATCH: (f64, f64) = (1.3, 1.6);

/// Length below which a half of u, or what [`apart`] leaves of u, has no direction.
const NO_DIRECTION: f64 = 1e-9;

/// Curvature below which a fold has no coordinate, 1/rad² on unit-scaled rows.
const FLAT: f64 = 1e-9;

/// Share of ∇s along v above which s is a coordinate of the fold.
const SLOPE: f64 = 0.1;

/// Shares of the strongest curvature along a, of a vector measure, from and to which the fold's coordinate takes the place of a's own.
const LEADS: [f64; 2] = [0.3, 0.7];

/// Postures sampled for σ_ref, and singular ones per name for the type that is most frequent.
const SAMPLES: (usize, u32) = (256, 6);

/// Share of rotation in u² above which ζ becomes a rotation, below which a translation, far from the neighbourhood: at a wrist, at an elbow or a
/// shoulder, and at what has no name. In it, where that changes only before the half that is left vanishes: of a vector measure, and of a signed one.
const ANGULAR: [(f64, f64); 5] = [
    (0.1, 0.05),
    (0.95, 0.9),
    (0.6, 0.4),
    (0.98, 0.02),
    (0.95, 0.05),
];

/// One direction that is tracked.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Entry<const N: usize> {
    /// Which direction of which block.
    block: usize,
    index: usize,
    /// Where it is reported.
    place: usize,
    angular: bool,
    latched: bool,
    /// Latched for a tick at least.
    settled: bool,
    /// ζ is −u: outwards at a fold. Settled with the type, so that it never changes inside.
    flipped: bool,
    verdict: Verdict,
    /// Unit auxiliary row in Π; zero before the first tick.
    a: Joints<N>,
}

/// The tracked singular directions of one arm.
#[derive(Clone, Debug)]
pub(super) struct Tracker<const N: usize> {
    geometry: Geometry,
    length_m: f64,
    /// η_in and η_out.
    eta: [BySingularity; 2],
    /// The whole of J; or C's translation by the joints before a spherical wrist, and the wrist's rotations.
    blocks: [TrackedSvd<N>; 2],
    block_count: usize,
    /// σ_ref of each block.
    reference: [f64; 2],
    entries: [Entry<N>; MAX_SINGULARITIES],
    count: usize,
    /// Names of the places, and the type that each has where it is not latched.
    places: [(Kind, Class); MAX_SINGULARITIES],
    place_count: usize,
    /// At the first tick.
    begins: bool,
    /// Whether the first tick looks up far directions, too.
    names_far: bool,
}

/// An arm in one posture: its screws at C, and C − S, m.
pub(super) type Arm<const N: usize> = (Screws<N>, Vector3);

impl<const N: usize> Tracker<N> {
    /// The directions of an arm in any posture. `names` are the places to report, in order; the last one is the second block's, where there are two.
    ///
    /// Cost about 5 ms, for the types off the singularities are found by projecting random postures onto them.
    pub(super) fn new(
        arm: &Arm<N>,
        geometry: Geometry,
        blocks: &[TrackedSvd<N>],
        length_m: f64,
        analysis: &Analysis,
        names: &[Kind],
    ) -> Self {
        let mut places = [(Kind::Numeric, Class::Unknown); MAX_SINGULARITIES];
        for (place, name) in places.iter_mut().zip(names) {
            place.0 = *name;
        }
        let place_count = names.len().min(MAX_SINGULARITIES);
        let first = blocks[0];
        let most = if first.is_square() {
            MAX_SINGULARITIES
        } else {
            TRACKED
        };
        let of_first = first.count.min(most).min(place_count + 1 - blocks.len());
        let entry = |k| Entry {
            block: usize::from(k >= of_first),
            index: if k < of_first { k } else { 0 },
            place: k,
            angular: k >= of_first,
            latched: false,
            settled: false,
            flipped: false,
            verdict: Verdict::default(),
            a: Joints::zeros(),
        };
        let mut out = Self {
            geometry,
            length_m,
            eta: [analysis.eta_in, analysis.eta_out],
            blocks: [first, blocks[blocks.len() - 1]],
            block_count: blocks.len(),
            reference: [1e-6; 2],
            entries: std::array::from_fn(entry),
            // A wrist's axes follow each other at an angle: no more than one of its directions is ever lost.
            count: of_first + blocks.len() - 1,
            places,
            place_count,
            begins: false,
            names_far: true,
        };
        out.sample(arm);
        out
    }

    /// σ_ref of every block, and the type that is the most frequent at each place, over a fixed set of postures.
    fn sample(&mut self, (screws, p): &Arm<N>) {
        let mut random = Uniform(1);
        // Per place, how often each type.
        let mut types = [[0_u32; 4]; MAX_SINGULARITIES];
        for _ in 0..SAMPLES.0 {
            let delta = Joints::from_fn(|_, _| random.within(-PI, PI));
            let (moved, by) = screws.moved(&delta);
            let arm = (moved, p + by);
            let rows = self.geometry.rows(&arm.0, &arm.1, self.length_m);
            let mut there = self.blocks;
            for (svd, reference) in there.iter_mut().zip(&mut self.reference) {
                svd.track(&rows);
                *reference = reference.max(svd.smallest());
            }
            let unknown = |place: usize| {
                types[place].iter().sum::<u32>() < SAMPLES.1
                    && self.places[place].0 != Kind::Numeric
            };
            if self.geometry.S.is_some() && (0..self.place_count).any(unknown) {
                for i in 0..self.count {
                    let lock = classify(&self.geometry, &arm, there[0], i, self.length_m);
                    let named = |place: &usize| self.places[*place].0 == lock.names[0];
                    if lock.verdict.class != Class::Unknown {
                        for place in (0..self.place_count).filter(named) {
                            types[place][lock.verdict.class.code() as usize & 3] += 1;
                        }
                    }
                }
            }
        }
        for (place, class) in self.places.iter_mut().zip(types) {
            let most = (0..4)
                .filter(|code| class[*code] > 0)
                .max_by_key(|code| class[*code]);
            place.1 = most
                .and_then(|code| Class::from_code(code as u32))
                .unwrap_or(Class::Unknown);
        }
    }

    /// From now on the first tick, too, looks up near directions only, and far ones are reported as numeric, of unknown type.
    pub(super) fn leave_far_unnamed(&mut self) {
        self.names_far = false;
    }

    /// Whether the measures are vectors: with spare joints, where singularities have codimension two or more.
    pub(super) fn measures_vectors(&self) -> bool {
        !self.blocks[0].is_square()
    }

    /// One tick: fills the places of `out`, and returns how many there are.
    pub(super) fn measure(&mut self, at: &Posture<'_, N>, out: &mut [Singularity<N>]) -> usize {
        let arm = (
            Screws(at.at.J),
            at.at.p - self.geometry.S.unwrap_or_default(),
        );
        let rows = self.geometry.rows(&arm.0, &arm.1, self.length_m);
        for block in &mut self.blocks[..self.block_count] {
            block.track(&rows);
        }
        self.track_the_smallest();
        self.begins = !is_set(&self.entries[0].a);
        for k in 0..self.count {
            self.latch(k, &arm);
        }
        for (one, (kind, class)) in out.iter_mut().zip(&self.places[..self.place_count]) {
            *one = Singularity {
                kind: *kind,
                class: *class,
                s: 1.0,
                gain: 1.0,
                zeta_B: stack(&Vector3::x(), &Vector3::zeros()),
                R_BS: Matrix3::identity(),
                aux_row: unit(0),
                aux_rate: at.qdot[0],
                ..Singularity::none()
            };
        }
        for block in 0..self.block_count {
            self.carry(block);
        }
        let mut before = [(Vector6::zeros(), Vector6::zeros()); MAX_SINGULARITIES];
        let mut latched = 0;
        for k in 0..self.count {
            let place = self.entries[k].place;
            out[place] = self.singularity(k, at, &arm, &before[..latched]);
            if self.entries[k].latched {
                before[latched] = (out[place].zeta_B, self.left_vector(k, &arm.1));
                latched += 1;
            }
        }
        self.place_count
    }

    /// |σ|/σ_ref.
    fn size(&self, block: usize, index: usize) -> f64 {
        self.blocks[block].sigma[index].abs() / self.reference[block]
    }

    /// u of an entry, on scaled rows.
    fn left_vector(&self, k: usize, p: &Vector3) -> Vector6 {
        let Entry { block, index, .. } = self.entries[k];
        self.geometry
            .without_elbow(self.blocks[block].covector(index), p)
    }

    fn tracks(&self, block: usize, index: usize) -> Option<usize> {
        self.entries[..self.count]
            .iter()
            .position(|entry| (entry.block, entry.index) == (block, index))
    }

    /// A direction that is not tracked and is smaller than one that is, and not latched, takes its turn: where the two are equal.
    fn track_the_smallest(&mut self) {
        for index in 0..self.blocks[0].count {
            if self.tracks(0, index).is_some() {
                continue;
            }
            let size = |k: usize| self.size(0, self.entries[k].index);
            let mut largest: Option<usize> = None;
            let is_free = |entry: &Entry<N>| entry.block == 0 && !entry.latched;
            for k in (0..self.count).filter(|k| is_free(&self.entries[*k])) {
                if largest.is_none_or(|other| size(k) > size(other)) {
                    largest = Some(k);
                }
            }
            if let Some(k) = largest.filter(|k| self.size(0, index) < size(*k)) {
                let block = &mut self.blocks[0];
                // On the side where the other one was, so that a signed s goes on without a step.
                if block.is_square()
                    && block.sigma[index] * block.sigma[self.entries[k].index] < 0.0
                {
                    (block.v[index], block.sigma[index]) = (-block.v[index], -block.sigma[index]);
                }
                self.entries[k].index = index;
            }
        }
    }

    /// Classifies an entry that comes near its singularity, and gives its type up where it has left it.
    fn latch(&mut self, k: usize, arm: &Arm<N>) {
        let Entry {
            block,
            index,
            place,
            latched,
            ..
        } = self.entries[k];
        let eta_out = self.neighborhood(self.places[place].0).eta_out;
        let within = |share: f64| self.size(block, index) <= share * eta_out;
        let stays = within(if latched { LATCH.1 } else { LATCH.0 });
        if self.begins && self.names_far || !latched && stays {
            let Lock {
                names,
                verdict,
                folds_along,
            } = classify(
                &self.geometry,
                arm,
                self.blocks[block],
                index,
                self.length_m,
            );
            self.entries[k].verdict = verdict;
            let is_one_sided = verdict.class == Class::Type1
                || verdict.class == Class::Mixed && !self.measures_vectors();
            self.entries[k].flipped = is_one_sided && folds_along;
            self.assign(k, names);
        }
        self.entries[k].latched = stays;
    }

    /// Reports entry `k` where its name belongs, or the second one where a latched direction has that; whatever was there goes to where `k` was.
    fn assign(&mut self, k: usize, names: [Kind; 2]) {
        let taken = |place: usize, entries: &[Entry<N>]| {
            entries.iter().position(|entry| entry.place == place)
        };
        let entries = &self.entries[..self.count];
        if entries[k].block == 1
            || names[0] == Kind::Numeric && self.places[entries[k].place].0 == Kind::Numeric
        {
            return;
        }
        let free = |place: &usize| {
            taken(*place, entries).is_none_or(|other| other == k || !entries[other].latched)
        };
        let named = |name: Kind| {
            (0..self.place_count)
                .filter(|place| self.places[*place].0 == name)
                .find(free)
        };
        let wanted = names.into_iter().find_map(named);
        let Some(place) = wanted.or_else(|| named(Kind::Numeric)) else {
            return;
        };
        let before = self.entries[k].place;
        if let Some(other) = taken(place, &self.entries[..self.count]) {
            self.entries[other].place = before;
        }
        self.entries[k].place = place;
    }

    /// The directions orthogonal to Π of entry `k`: the other directions of its block, tracked ones by their auxiliary rows.
    fn others(&self, k: usize) -> Basis<N> {
        let block = self.entries[k].block;
        let mut span = self.blocks[block].absent();
        for j in 0..self.blocks[block].count {
            match self.tracks(block, j) {
                None => span.push(self.blocks[block].v[j]),
                Some(other) if other != k => span.push(self.entries[other].a),
                Some(_) => {}
            }
        }
        span
    }

    /// Carries every a of a block to the new posture: beyond η_out it is v, else the old one without what has left Π.
    fn carry(&mut self, block: usize) {
        let svd = &self.blocks[block];
        let mut span = svd.absent();
        for j in (0..svd.count).filter(|j| self.tracks(block, *j).is_none()) {
            span.push(svd.v[j]);
        }
        let near: [bool; MAX_SINGULARITIES] = std::array::from_fn(|k| self.is_near(k));
        for inside in [false, true] {
            for k in (0..self.count).filter(|k| near[*k] == inside) {
                let Entry { a, index, .. } = self.entries[k];
                if self.entries[k].block != block {
                    continue;
                }
                let v = self.blocks[block].v[index];
                let v = if v.dot(&a) < 0.0 { -v } else { v };
                let carried = span.residual(if inside && is_set(&a) { a } else { v });
                let carried = if carried.norm() > UNDEFINED {
                    carried
                } else {
                    span.residual(v)
                };
                let a = if carried.norm() > UNDEFINED {
                    carried.normalize()
                } else {
                    span.any()
                };
                // Twice is exact to rounding.
                let a = span.residual(a).normalize();
                self.entries[k].a = a;
                span.push(a);
            }
        }
    }

    /// Whether entry `k` is within η_out, so that its row is carried.
    fn is_near(&self, k: usize) -> bool {
        let entry = &self.entries[k];
        let near = self.neighborhood(self.places[entry.place].0);
        self.size(entry.block, entry.index) < near.eta_out
    }

    /// How far entry `k` is singular alone, 0 to 1: a fold's curvature tells nothing of the motions that a second lost direction leaves free.
    fn alone(&self, k: usize) -> f64 {
        let block = self.entries[k].block;
        (0..self.count)
            .filter(|j| *j != k && self.entries[*j].block == block)
            .map(|j| self.openness(j))
            .product()
    }

    /// 0 within η_in of entry `k`, 1 beyond η_out.
    fn openness(&self, k: usize) -> f64 {
        let entry = &self.entries[k];
        let near = self.neighborhood(self.places[entry.place].0);
        near.openness(self.size(entry.block, entry.index))
    }

    /// The neighbourhood of singularities of this name.
    fn neighborhood(&self, kind: Kind) -> Neighborhood {
        let [eta_in, eta_out] = self.eta.map(|eta| eta.of(kind.code()));
        Neighborhood { eta_in, eta_out }
    }

    /// The second order of entry `k`, its auxiliary row turned; `before` are ζ and u of the latched entries before it.
    fn second_order(
        &self,
        k: usize,
        arm: &Arm<N>,
        before: &[(Vector6, Vector6)],
    ) -> SecondOrder<N> {
        let (entry, u) = (self.entries[k], self.left_vector(k, &arm.1));
        let (svd, i) = (&self.blocks[entry.block], entry.index);
        let (kind, usual) = self.places[entry.place];
        let own = if entry.latched { apart(u, before) } else { u };
        let (angular, half) = larger_half(&own, kind, &entry, svd.is_square());
        let covector = unscaled(&own, self.length_m);
        let class = if entry.latched || entry.verdict.class != Class::Unknown {
            entry.verdict.class
        } else {
            usual
        };
        let Q = arm.0.hessian(&unscaled(&u, self.length_m));
        let m = svd.v[i] * svd.sigma[i];
        let turn = Turn {
            class,
            s: self.size(entry.block, i).max(SMALLEST),
            near: self.neighborhood(kind),
            m,
            v: svd.v[i],
            Q: &Q,
            begins: self.begins && !svd.is_square(),
        };
        let others = entry.latched.then(|| self.others(k));
        let (a, curvature_b) = turn.of(entry.a, others, |y| self.half_rate(k, arm, y, angular));
        let curvature = a.dot(&(Q * a));
        // Of a signed fold ∇s must have a share along v, of a vector measure's a must have much of the strongest curvature.
        let (gradient, slope) = (Q.tr_mul(&svd.v[i]), svd.v[i].dot(&(Q * svd.v[i])));
        let fold = if class != Class::Type1 || !entry.latched || curvature.abs() <= FLAT {
            0.0
        } else if svd.is_square() {
            f64::from(u8::from(slope.abs() > SLOPE * gradient.norm()))
        } else {
            let [few, most] = LEADS;
            let share = curvature.abs() / entry.verdict.kappa_1;
            smoothstep((share - few) / (most - few)) * self.alone(k)
        };
        let along_fold = (fold > 0.0 && svd.is_square())
            .then(|| half_of(&svd.along_fold(i, &gradient, slope), angular))
            .filter(|half| half.norm() > NO_DIRECTION);
        SecondOrder {
            class,
            angular,
            half: along_fold.unwrap_or(half),
            other: half_of(&covector, !angular)
                / half_of(&covector, angular).norm().max(NO_DIRECTION),
            Q,
            a,
            m,
            curvature,
            curvature_b,
            fold,
        }
    }

    /// The singularity of entry `k`; `before` are ζ and u of the latched entries before it.
    fn singularity(
        &mut self,
        k: usize,
        at: &Posture<'_, N>,
        arm: &Arm<N>,
        before: &[(Vector6, Vector6)],
    ) -> Singularity<N> {
        let (entry, order) = (self.entries[k], self.second_order(k, arm, before));
        let (svd, reference) = (&self.blocks[entry.block], self.reference[entry.block]);
        let sigma = svd.sigma[entry.index];
        let size = self.size(entry.block, entry.index).max(SMALLEST);
        let SecondOrder {
            class, angular, a, ..
        } = order;
        let outwards = if entry.flipped { -1.0 } else { 1.0 };
        let length = order.half.norm();
        let axis = order.half / (outwards * length);
        let per_aux = outwards * if angular { 1.0 } else { self.length_m } / length;
        let (towards, kappa_2) = self.second_axis(k, at, arm, &order, (&axis, outwards / length));
        let (aux, aux_row) = order.coordinate();
        let (along, bend) = (order.m.dot(&a), -order.curvature * per_aux);
        self.entries[k] = Entry {
            angular,
            settled: entry.latched,
            a,
            ..entry
        };
        let (kind, class) = if entry.latched || self.names_far {
            (self.places[entry.place].0, class)
        } else {
            (Kind::Numeric, Class::Unknown)
        };
        Singularity {
            kind,
            class,
            angular,
            s: if svd.is_square() {
                size.copysign(sigma)
            } else {
                size
            },
            s_rate: self.rate(svd, entry.index, arm, &order.Q, at.qdot) / reference,
            zeta_B: halves(&axis, angular),
            other: order.other * outwards,
            R_BS: frame(&axis, &towards),
            gain: (per_aux * sigma.abs().max(SMALLEST * reference))
                .copysign(per_aux * if along < 0.0 { -1.0 } else { 1.0 }),
            askew: 1.0 - along.abs() / sigma.abs().max(SMALLEST * reference).max(along.abs()),
            aux,
            aux_rate: aux_row.dot(at.qdot),
            aux_bias: if order.fold < 1.0 {
                (1.0 - order.fold) * self.bias(k, &a, &arm.0, at)
            } else {
                0.0
            },
            aux_row,
            kappa_1: match (class, entry.latched, svd.is_square()) {
                _ if order.fold > 0.0 => bend.abs(),
                (Class::Mixed, true, true) => bend.max(0.0),
                (Class::Mixed | Class::Type2, true, false) => bend,
                _ => entry.verdict.kappa_1,
            },
            kappa_2,
            ..Singularity::none()
        }
    }

    /// Where the second axis of entry `k`'s singular frame points, and κ₂: ζ turns about that axis by κ₂ per rad of a. ζ is `axis`, half of u times `per_u`.
    fn second_axis(
        &self,
        k: usize,
        at: &Posture<'_, N>,
        arm: &Arm<N>,
        order: &SecondOrder<N>,
        (axis, per_u): (&Vector3, f64),
    ) -> (Vector3, f64) {
        let (usual, entry) = (towards(at, axis), &self.entries[k]);
        let turns =
            order.class == Class::Type2 || order.class == Class::Mixed && !self.measures_vectors();
        if !turns || !entry.latched {
            return (usual, entry.verdict.kappa_2);
        }
        let turn = self.half_rate(k, arm, &order.a, order.angular) * per_u;
        let turn = turn - axis * axis.dot(&turn);
        let kappa_2 = turn.norm();
        let is_turned = kappa_2 > TURNS;
        (if is_turned { axis.cross(&turn) } else { usual }, kappa_2)
    }

    /// How a half of u turns along the joint motion `y`, 1/rad.
    fn half_rate(&self, k: usize, arm: &Arm<N>, y: &Joints<N>, is_angular: bool) -> Vector3 {
        let Entry { block, index, .. } = self.entries[k];
        let rate = self.blocks[block].turning(&arm.0.rate(y), index, self.length_m);
        half_of(&rate, is_angular)
    }

    /// σ̇, or d|m|/dt of a vector measure, 1/s.
    fn rate(
        &self,
        svd: &TrackedSvd<N>,
        i: usize,
        (screws, p): &Arm<N>,
        Q: &SMatrix<f64, N, N>,
        qdot: &Joints<N>,
    ) -> f64 {
        let (v, u) = (svd.v[i], svd.covector(i));
        let up = if svd.sigma[i] < 0.0 && !svd.is_square() {
            -v
        } else {
            v
        };
        let turning = self.geometry.turning(
            screws,
            p,
            [u.as_slice(), up.as_slice(), qdot.as_slice()],
            self.length_m,
        );
        Q.tr_mul(&up).dot(qdot) + turning
    }

    /// ȧ·q̇ while a is carried: ȧ leaves Π only, by −Σ_j v_j (u_jᵀḂa)/σ_j over the directions j that are not lost.
    ///
    /// Lost ones beside it span Π with it, and their own rows are carried, too.
    fn bias(&self, k: usize, a: &Joints<N>, screws: &Screws<N>, at: &Posture<'_, N>) -> f64 {
        let Entry { block, index, .. } = self.entries[k];
        let svd = &self.blocks[block];
        let Ba = screws.rate(at.qdot) * a;
        let is_carried = |j: usize| {
            j == index || (self.tracks(block, j)).is_some_and(|other| self.is_near(other))
        };
        let mut bias = 0.0;
        for j in (0..svd.count).filter(|j| !is_carried(*j)) {
            let sigma = svd.sigma[j];
            let pushed = unscaled(&svd.covector(j), self.length_m).dot(&Ba);
            bias -= pushed * sigma / (sigma * sigma + SQUARED_GAP) * svd.v[j].dot(at.qdot);
        }
        bias
    }

    /// Writes what must survive a restart.
    pub(super) fn save(&self, out: &mut AnalyzerCheckpoint) {
        for (out, block) in out.blocks.iter_mut().zip(&self.blocks[..self.block_count]) {
            *out = block.checkpoint();
        }
        for (out, entry) in out.places.iter_mut().zip(&self.entries) {
            *out = PlaceCheckpoint {
                index: entry.index as u32,
                place: entry.place as u32,
                class: entry.verdict.class.code(),
                angular: u32::from(entry.angular),
                latched: u32::from(entry.latched),
                flipped: u32::from(entry.flipped),
                kappa_1: entry.verdict.kappa_1,
                kappa_2: entry.verdict.kappa_2,
                direction: padded(&entry.a),
            };
        }
    }

    /// Takes up what [`save`](Self::save) has written.
    pub(super) fn restore(&mut self, from: &AnalyzerCheckpoint) {
        for (block, from) in self.blocks[..self.block_count].iter_mut().zip(&from.blocks) {
            block.restore(from);
        }
        for (entry, from) in self.entries.iter_mut().zip(&from.places) {
            let class = Class::from_code(from.class);
            // Without a type that exists it is classified again.
            let latched = from.latched != 0 && class.is_some();
            let last = self.blocks[entry.block].count.saturating_sub(1);
            *entry = Entry {
                block: entry.block,
                index: (from.index as usize).min(last),
                place: (from.place as usize).min(self.place_count.saturating_sub(1)),
                angular: from.angular != 0,
                latched,
                settled: latched,
                flipped: from.flipped != 0,
                verdict: Verdict {
                    class: class.unwrap_or(Class::Unknown),
                    kappa_1: from.kappa_1,
                    kappa_2: from.kappa_2,
                },
                a: joints(&from.direction),
            };
        }
    }
}

/// A direction at one tick, with the motion along ζ to the second order: x = mᵀy + yᵀQy/2.
struct SecondOrder<const N: usize> {
    class: Class,
    angular: bool,
    /// The half of u that ζ takes.
    half: Vector3,
    /// The other half over the length of that one, as covectors of J's own rows.
    other: Vector3,
    /// u·H.
    Q: SMatrix<f64, N, N>,
    a: Joints<N>,
    m: Joints<N>,
    /// aᵀQa, and what is mixed with the rest of Π.
    curvature: f64,
    curvature_b: Joints<N>,
    /// How far the coordinate is that of a fold: 0 where it is a's own, 1 where the fold's curvature leads.
    fold: f64,
}

impl<const N: usize> SecondOrder<N> {
    /// The auxiliary coordinate and its gradient.
    fn coordinate(&self) -> (f64, Joints<N>) {
        let Self {
            Q,
            a,
            m,
            curvature,
            fold,
            ..
        } = self;
        if *fold > 0.0 {
            let along_fold = Q.tr_mul(a) / *curvature;
            return (m.dot(a) / curvature * fold, a + (along_fold - a) * *fold);
        }
        let leads = a * *curvature + self.curvature_b;
        let aux = m.dot(&leads) / leads.norm_squared().max(1e-4);
        (if self.class == Class::Mixed { aux } else { 0.0 }, *a)
    }
}

/// The target of a singular frame's second axis: the last joint's axis, or the one before it where ζ lies along that.
fn towards<const N: usize>(at: &Posture<'_, N>, axis: &Vector3) -> Vector3 {
    let z = at.terms.z[N - 1];
    if N < 2 || z.dot(axis).abs() < 0.9 {
        z
    } else {
        at.terms.z[N - 2]
    }
}

fn is_set<const N: usize>(a: &Joints<N>) -> bool {
    a.norm_squared() > 0.0
}

/// A left vector as a covector of J's own rows: linear ones 1/m.
pub(super) fn unscaled(u: &Vector6, length_m: f64) -> Vector6 {
    let mut a = *u;
    a.fixed_rows_mut::<3>(0).scale_mut(1.0 / length_m);
    a
}

/// Left null vector `u` without what has been given the directions ζ before it, each a pair of ζ and its own u, on scaled rows.
///
/// Where two directions are lost any two vectors span them: both may be largest in the same half, along the same axis, and the rows that are kept then
/// lack one. u − u_1·(ζ_1ᵀu)/(ζ_1ᵀu_1) is lost just as u is, and has nothing along ζ_1. Where nothing would be left of u, it stays.
fn apart(u: Vector6, before: &[(Vector6, Vector6)]) -> Vector6 {
    before.iter().fold(u, |u, (zeta, other)| {
        let own = zeta.dot(other);
        let left = u - other * (zeta.dot(&u) / own);
        if own.abs() < 0.1 || left.norm() < NO_DIRECTION {
            u
        } else {
            left
        }
    })
}

/// Whether ζ is the rotation of u, and the half of u that it takes; by the hysteresis of its neighbourhood and its name.
fn larger_half<const N: usize>(
    u: &Vector6,
    kind: Kind,
    entry: &Entry<N>,
    is_square: bool,
) -> (bool, Vector3) {
    let (above, below) = match (entry.latched && entry.settled, kind) {
        (true, _) if is_square => ANGULAR[4],
        (true, _) => ANGULAR[3],
        (_, Kind::Wrist) => ANGULAR[0],
        (_, Kind::Elbow | Kind::Shoulder) => ANGULAR[1],
        // A direction that moves the hand to the second order is lost as a translation; one that only turns ζ, as a rotation where there is one.
        _ if is_square && entry.verdict.class == Class::Type2 => ANGULAR[0],
        _ if is_square && entry.verdict.class != Class::Unknown => ANGULAR[1],
        _ => ANGULAR[2],
    };
    let (linear, rotation) = (linear(u).norm_squared(), angular(u).norm_squared());
    let share = rotation / (linear + rotation);
    let is_angular = share > if entry.angular { below } else { above };
    let half = half_of(u, is_angular);
    // Nothing is lost along a u that has no length: any direction will do.
    (
        is_angular,
        if half.norm() > NO_DIRECTION {
            half
        } else {
            Vector3::x()
        },
    )
}
