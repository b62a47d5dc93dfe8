//! Lost directions of an arm with spare joints, by number: each measured by a vector, for most of them have codimension two or more.
//!
//! # Measure
//! J has R rows and N > R columns, those of absent joints apart. At a singular posture u is the left null vector of the unit-scaled J, and the joint
//! motions that the other directions leave free span Π, of dimension d = N − R + 1. Near by, uᵀJ = mᵀ with m in Π: s = |m|/σ_ref ≥ 0, since m = 0 is
//! d conditions, which a path misses, or passes at a distance of |m|. ζ is the larger half of u, as on any arm by number, and u is carried from tick
//! to tick.
//!
//! # Auxiliary coordinate
//! m may turn by half a turn around the singular posture within a few ticks, so no auxiliary row follows it there. The row is a unit vector a in Π that
//! is carried from tick to tick without turning in Π. It is turned towards ±m outside η_in, at a bounded rate, and *is* ±m beyond η_out. Inside, it is
//! turned towards the direction that the type asks for, at a bounded rate too.
//!
//! # Places
//! A direction is reported where its name belongs. The name is that of the singular posture to which Newton's method leads it, looked up when |s| falls
//! below 1.3 η_out; beyond that a place may pass from one direction to another, and s of a place is continuous only up to there.
//!
//! # Types
//! The motion along ζ is x = mᵀy + yᵀCy/2 for y in Π, C the curvature (u·H restricted to Π). Its eigenvalues give the type:
//!
//! | C | type | a | reference |
//! |---|---|---|---|
//! | definite, or all but zero on one side | 1: a fold | strongest curvature | y_d² = y² + 2ζᵀe/h |
//! | indefinite | mixed | self-motion, aᵀCa = 0 | it is followed out of the neighbourhood: x stays, and \|m\| = \|Ca\|·y grows |
//! | zero | 2 | what turns ζ fastest | ζ is turned until what is left of the path is orthogonal to it |
#![allow(
    clippy::needless_range_loop,
    reason = "indices name rows and directions of several arrays at once"
)]

mod auxiliary_row;
mod checkpoint;
mod combination;

use auxiliary_row::{GONE, Turn};
use combination::{apart, is_set, larger_half, unscaled};

use super::axes::frame;
use super::block::Block;
use super::classify::{FOLD, Verdict, self_motion};
use super::family::Posture;
use super::lost_geometry::{Geometry, Span};
use super::screws::Screws;
use super::thresholds::{LATCH, SQUARED_GAP};
use crate::linear::{Lu, angular, linear, stack, symmetric_eigen};
use crate::paper::type_2::TURNS;
use crate::types::{Class, Kind, Singularity};
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use shared_types::MAX_SINGULARITIES;
use shared_types::bounds::within;
use shared_types::random::Uniform;
use shared_types::scenario::{Analysis, BySingularity};

/// Directions that are followed at once: the smallest ones.
pub(super) const FOLLOWED: usize = 3;

/// s is never exactly zero: its sign is the side.
pub(crate) const SMALLEST: f64 = 1e-12;

/// Most Newton steps onto m = 0, the largest step in any joint, rad, and |m| that counts as zero.
const NEWTON: (usize, f64, f64) = (24, 0.3, 1e-8);

/// Postures sampled for σ_ref, and singular ones per name for the type that is most frequent.
const SAMPLES: (usize, u32) = (256, 6);

/// One direction that is followed.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Entry<const N: usize> {
    /// Which direction of the block.
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
    a: SVector<f64, N>,
}

/// The lost directions of an arm with spare joints.
#[derive(Clone, Debug)]
pub(super) struct LostDirections<const N: usize> {
    geometry: Geometry,
    length_m: f64,
    task: [bool; 6],
    eta: [BySingularity; 2],
    block: Block<N>,
    /// σ_ref.
    reference: f64,
    entries: [Entry<N>; FOLLOWED],
    count: usize,
    /// Names of the places, and the type that each has where it is not latched.
    places: [(Kind, Class); MAX_SINGULARITIES],
    place_count: usize,
    /// At the first tick.
    begins: bool,
}

/// The singular posture that a direction leads to.
#[derive(Clone, Copy, Debug)]
struct Lock {
    /// Its name, and the one that a second direction has there.
    names: [Kind; 2],
    verdict: Verdict,
    /// The strongest curvature moves the end-effector along u, not against it.
    folds_along: bool,
}

impl<const N: usize> LostDirections<N> {
    /// The directions of an arm in the posture `screws`, C at `p` from S. `places` are the names to report, in order.
    ///
    /// Requires fewer task axes than the `dof` joints. Cost about 5 ms, for the types off the singularities are found by projecting random postures onto them.
    pub(super) fn new(
        (screws, p): (&Screws<N>, Vector3<f64>),
        geometry: Geometry,
        (length_m, task, dof): (f64, [bool; 6], usize),
        analysis: &Analysis,
        names: &[Kind],
    ) -> Self {
        let block = Block::new((0..6).filter(|k| task[*k]), (0, dof));
        let mut places = [(Kind::Numeric, Class::Unknown); MAX_SINGULARITIES];
        for (place, name) in places.iter_mut().zip(names) {
            place.0 = *name;
        }
        let place_count = names.len().min(MAX_SINGULARITIES);
        let entry = |k| Entry {
            index: k,
            place: k,
            angular: false,
            latched: false,
            settled: false,
            flipped: false,
            verdict: Verdict::default(),
            a: SVector::zeros(),
        };
        let mut out = Self {
            geometry,
            length_m,
            task,
            eta: [analysis.eta_in, analysis.eta_out],
            block,
            reference: 1e-6,
            entries: std::array::from_fn(entry),
            count: block.count.min(FOLLOWED).min(place_count),
            places,
            place_count,
            begins: false,
        };
        let mut random = Uniform(1);
        // Per place, how often each type.
        let mut types = [[0_u32; 4]; MAX_SINGULARITIES];
        for _ in 0..SAMPLES.0 {
            let delta =
                SVector::from_fn(|_, _| random.within(-std::f64::consts::PI, std::f64::consts::PI));
            let (moved, by) = screws.moved(&delta);
            let mut one = out.block;
            one.track(&geometry.rows(&moved, &(p + by), length_m));
            out.reference = out.reference.max(one.smallest());
            let known = |place: usize| {
                types[place].iter().sum::<u32>() >= SAMPLES.1 || places[place].0 == Kind::Numeric
            };
            if !(0..place_count).all(known) {
                for i in 0..out.count {
                    let Lock { names, verdict, .. } = out.classify(&moved, &(p + by), one, i);
                    for place in (0..place_count).filter(|place| {
                        verdict.class != Class::Unknown && places[*place].0 == names[0]
                    }) {
                        types[place][verdict.class.code() as usize & 3] += 1;
                    }
                }
            }
        }
        for (place, class) in out.places.iter_mut().zip(types) {
            let most = (0..4)
                .filter(|code| class[*code] > 0)
                .max_by_key(|code| class[*code]);
            place.1 = most
                .and_then(|code| Class::from_code(code as u32))
                .unwrap_or(Class::Unknown);
        }
        out
    }

    /// Kind and type of direction `i` of `block`, on a copy of the arm projected onto m = 0 by Newton's method in the joints.
    ///
    /// Cost bounded, about 50 µs: not for every tick. No allocation.
    fn classify(&self, screws: &Screws<N>, p: &Vector3<f64>, block: Block<N>, i: usize) -> Lock {
        let (mut screws, mut p, mut block) = (*screws, *p, block);
        let mut moved = SVector::<f64, N>::zeros();
        let (steps, longest, zero) = NEWTON;
        let mut free = [SVector::<f64, N>::zeros(); 3];
        let mut Q = SMatrix::<f64, N, N>::zeros();
        let mut left = f64::INFINITY;
        for _ in 0..steps {
            let m = block.v(i) * block.sigma(i);
            let mut span = Span::of_absent(&block);
            for j in (0..block.count).filter(|j| *j != i) {
                span.push(block.v(j));
            }
            free = [SVector::zeros(); 3];
            for e in free.iter_mut().take(N - span.count) {
                *e = span.any();
                span.push(*e);
            }
            let u = self.geometry.without_elbow(block.covector(i), &p);
            Q = screws.hessian(&unscaled(&u, self.length_m));
            left = m.norm();
            if within(left, zero) {
                break;
            }
            let gradients = free.map(|e| Q.tr_mul(&e));
            let mut gram = Matrix3::from_fn(|a, b| gradients[a].dot(&gradients[b]));
            for (k, e) in free.iter().enumerate() {
                gram[(k, k)] += if is_set(e) { 1e-9 } else { 1.0 };
            }
            let Ok(lu) = Lu::new(gram) else { break };
            let share = lu.solve(&Vector3::from_fn(|k, _| -m.dot(&free[k])));
            let step: SVector<f64, N> = (0..3).map(|k| gradients[k] * share[k]).sum();
            let step = step * (longest / step.amax().max(longest));
            moved += step;
            let (next, by) = screws.moved(&step);
            (screws, p) = (next, p + by);
            block.track(&self.geometry.rows(&screws, &p, self.length_m));
        }
        let distance = moved.norm();
        if !within(left, zero) {
            return Lock {
                names: [Kind::Numeric; 2],
                verdict: Verdict {
                    distance,
                    ..Verdict::default()
                },
                folds_along: false,
            };
        }
        let (curvatures, _) = symmetric_eigen(&Matrix3::from_fn(|a, b| {
            0.5 * (free[a].dot(&(Q * free[b])) + free[b].dot(&(Q * free[a])))
        }));
        let (highest, lowest) = (curvatures.max().max(0.0), curvatures.min().min(0.0));
        let kappa_1 = highest.max(-lowest);
        let motion = free[0];
        let kappa_2 = block
            .turning(&screws.rate(&motion), i, self.length_m)
            .norm();
        let class = if kappa_1 > FOLD {
            if highest.min(-lowest) <= 0.1 * kappa_1 {
                Class::Type1
            } else {
                Class::Mixed
            }
        } else if self_motion(&screws, &block, i, &motion, self.length_m, &self.task) {
            Class::Type2
        } else {
            Class::Mixed
        };
        let verdict = Verdict {
            class,
            kappa_1,
            kappa_2,
            distance,
        };
        Lock {
            names: self.geometry.names(&screws, &p),
            verdict,
            folds_along: highest > -lowest,
        }
    }

    /// One tick: fills the places of `out`, and returns how many there are.
    pub(super) fn measure(&mut self, at: &Posture<'_, N>, out: &mut [Singularity<N>]) -> usize {
        let screws = Screws(at.at.J);
        let p = at.at.p - self.geometry.S.unwrap_or_default();
        self.block
            .track(&self.geometry.rows(&screws, &p, self.length_m));
        self.follow_the_smallest();
        let begins = !is_set(&self.entries[0].a);
        self.begins = begins;
        for k in 0..self.count {
            let Entry {
                index,
                place,
                latched,
                ..
            } = self.entries[k];
            let eta_out = self.eta[1].of(self.places[place].0.code());
            let size = self.s(index).abs();
            if begins || !latched && size <= LATCH.0 * eta_out {
                let Lock {
                    names,
                    verdict,
                    folds_along,
                } = self.classify(&screws, &p, self.block, index);
                self.entries[k].verdict = verdict;
                self.entries[k].flipped = verdict.class == Class::Type1 && folds_along;
                self.assign(k, names);
            }
            let newly = !latched && size <= LATCH.0 * eta_out;
            self.entries[k].latched = if latched {
                size <= LATCH.1 * eta_out
            } else {
                newly
            };
        }
        for (place, one) in out.iter_mut().enumerate().take(self.place_count) {
            let (kind, class) = self.places[place];
            *one = Singularity {
                kind,
                class,
                s: 1.0,
                gain: 1.0,
                zeta_B: stack(&Vector3::x(), &Vector3::zeros()),
                ..Singularity::none()
            };
            one.R_BS = Matrix3::identity();
            one.aux_row = super::axes::unit(0);
        }
        self.carry();
        let mut before = [(SVector::zeros(), SVector::zeros()); FOLLOWED];
        let mut latched = 0;
        for k in 0..self.count {
            let place = self.entries[k].place;
            out[place] = self.singularity(k, at, (&screws, &p), &before[..latched]);
            if self.entries[k].latched {
                before[latched] = (
                    out[place].zeta_B,
                    self.geometry
                        .without_elbow(self.block.covector(self.entries[k].index), &p),
                );
                latched += 1;
            }
        }
        self.place_count
    }

    fn s(&self, index: usize) -> f64 {
        self.block.sigma(index).abs() / self.reference
    }

    /// A direction that is not followed and is smaller than one that is, and not latched, takes its turn: where the two are equal.
    fn follow_the_smallest(&mut self) {
        for index in 0..self.block.count {
            if self.entries[..self.count]
                .iter()
                .any(|entry| entry.index == index)
            {
                continue;
            }
            let mut largest: Option<usize> = None;
            for k in (0..self.count).filter(|k| !self.entries[*k].latched) {
                if largest.is_none_or(|other| {
                    self.s(self.entries[k].index) > self.s(self.entries[other].index)
                }) {
                    largest = Some(k);
                }
            }
            if let Some(k) = largest.filter(|k| self.s(index) < self.s(self.entries[*k].index)) {
                self.entries[k].index = index;
            }
        }
    }

    /// Reports entry `k` where its name belongs, or the second one where a latched direction has that; whatever was there goes to where `k` was.
    fn assign(&mut self, k: usize, names: [Kind; 2]) {
        let taken = |place: usize, entries: &[Entry<N>]| {
            entries.iter().position(|entry| entry.place == place)
        };
        let entries = &self.entries[..self.count];
        let fits = |place: &usize| {
            taken(*place, entries).is_none_or(|other| other == k || !entries[other].latched)
        };
        if names[0] == Kind::Numeric && self.places[entries[k].place].0 == Kind::Numeric {
            return;
        }
        let wanted = names.iter().find_map(|name| {
            (0..self.place_count)
                .filter(|place| self.places[*place].0 == *name)
                .find(fits)
        });
        let spare = || {
            (0..self.place_count)
                .filter(|place| self.places[*place].0 == Kind::Numeric)
                .find(fits)
        };
        let Some(place) = wanted.or_else(spare) else {
            return;
        };
        let before = self.entries[k].place;
        if let Some(other) = taken(place, &self.entries[..self.count]) {
            self.entries[other].place = before;
        }
        self.entries[k].place = place;
    }

    /// The directions orthogonal to Π of entry `k`: the other directions, followed ones by their auxiliary rows.
    fn others(&self, k: usize) -> Span<N> {
        let mut span = Span::of_absent(&self.block);
        for j in 0..self.block.count {
            match self.entries[..self.count]
                .iter()
                .position(|entry| entry.index == j)
            {
                None => span.push(self.block.v(j)),
                Some(other) if other != k => span.push(self.entries[other].a),
                Some(_) => {}
            }
        }
        span
    }

    /// Carries every a to the new posture: beyond η_out it is v, else the old one without what has left Π.
    fn carry(&mut self) {
        let mut span = Span::of_absent(&self.block);
        for j in 0..self.block.count {
            if !self.entries[..self.count]
                .iter()
                .any(|entry| entry.index == j)
            {
                span.push(self.block.v(j));
            }
        }
        let near = self
            .entries
            .map(|entry| self.s(entry.index) < self.eta[1].of(self.places[entry.place].0.code()));
        for inside in [false, true] {
            for k in (0..self.count).filter(|k| near[*k] == inside) {
                let Entry { a, index, .. } = self.entries[k];
                let v = self.block.v(index);
                let v = if v.dot(&a) < 0.0 { -v } else { v };
                let carried = span.residual(if inside && is_set(&a) { a } else { v });
                let carried = if carried.norm() > GONE {
                    carried
                } else {
                    span.residual(v)
                };
                let a = if carried.norm() > GONE {
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

    /// The singularity of entry `k`; `before` are ζ and u of the latched entries before it.
    fn singularity(
        &mut self,
        k: usize,
        at: &Posture<'_, N>,
        (screws, p): (&Screws<N>, &Vector3<f64>),
        before: &[(SVector<f64, 6>, SVector<f64, 6>)],
    ) -> Singularity<N> {
        let entry = self.entries[k];
        let (i, L) = (entry.index, self.length_m);
        let (kind, usual) = self.places[entry.place];
        let eta = self.eta.map(|eta| eta.of(kind.code()));
        let (sigma, v) = (self.block.sigma(i), self.block.v(i));
        let m = v * sigma;
        let s = self.s(i).max(SMALLEST);
        let u = self.geometry.without_elbow(self.block.covector(i), p);
        let own = if entry.latched { apart(u, before) } else { u };
        let (angular, half) =
            larger_half(&own, kind, entry.latched && entry.settled, entry.angular);
        let size = half.norm().max(1e-9);
        let (mut axis, mut per_aux) = (half / size, if angular { 1.0 } else { L } / size);
        let class = if entry.latched || entry.verdict.class != Class::Unknown {
            entry.verdict.class
        } else {
            usual
        };

        let Q = screws.hessian(&unscaled(&u, L));
        let up = if sigma < 0.0 { -v } else { v };
        let turning = self.geometry.turning(
            screws,
            p,
            [
                self.block.covector(i).as_slice(),
                up.as_slice(),
                at.qdot.as_slice(),
            ],
            L,
        );
        let s_rate = (Q.tr_mul(&up).dot(at.qdot) + turning) / self.reference;

        let turn = Turn {
            class,
            s,
            eta,
            m,
            v,
            Q: &Q,
            begins: self.begins,
        };
        let (a, curvature_b) = turn.of(entry.a, entry.latched.then(|| self.others(k)), |y| {
            self.zeta_rate(i, screws, y, angular)
        });
        let curvature = a.dot(&(Q * a));
        let along = m.dot(&a);
        let fold =
            class == Class::Type1 && entry.latched && curvature.abs() > 0.2 * entry.verdict.kappa_1;
        if entry.flipped {
            (axis, per_aux) = (-axis, -per_aux);
        }
        let gain = per_aux
            * sigma.abs().max(SMALLEST * self.reference)
            * if along < 0.0 { -1.0 } else { 1.0 };
        let zeta_B = if angular {
            stack(&Vector3::zeros(), &axis)
        } else {
            stack(&axis, &Vector3::zeros())
        };
        let (mut towards, mut kappa_2) = (self.towards(at, &axis), entry.verdict.kappa_2);
        if class == Class::Type2 && entry.latched {
            // ζ turns about the second axis of its frame by κ₂ per rad of a.
            let turn = self.zeta_rate(i, screws, &a, angular)
                * (if entry.flipped { -1.0 } else { 1.0 } / size);
            let turn = turn - axis * axis.dot(&turn);
            kappa_2 = turn.norm();
            if kappa_2 > TURNS {
                towards = axis.cross(&turn);
            }
        }
        let (aux, aux_row, aux_bias) = if fold {
            (along / curvature, Q.tr_mul(&a) / curvature, 0.0)
        } else {
            let leads = a * curvature + curvature_b;
            let aux = if class == Class::Mixed {
                m.dot(&leads) / leads.norm_squared().max(1e-4)
            } else {
                0.0
            };
            (aux, a, self.bias(k, &a, screws, at))
        };
        self.entries[k] = Entry {
            angular,
            settled: entry.latched,
            a,
            ..entry
        };
        Singularity {
            kind,
            class,
            angular,
            s,
            s_rate,
            zeta_B,
            R_BS: frame(&axis, &towards),
            gain,
            aux,
            aux_rate: aux_row.dot(at.qdot),
            aux_bias,
            aux_row,
            kappa_1: if fold {
                (curvature * per_aux).abs()
            } else {
                entry.verdict.kappa_1
            },
            kappa_2,
            ..Singularity::none()
        }
    }

    /// How the linear or the angular half of u turns along the joint motion `y`, 1/rad.
    fn zeta_rate(
        &self,
        i: usize,
        screws: &Screws<N>,
        y: &SVector<f64, N>,
        is_angular: bool,
    ) -> Vector3<f64> {
        let rate = self.block.turning(&screws.rate(y), i, self.length_m);
        if is_angular {
            angular(&rate)
        } else {
            linear(&rate)
        }
    }

    /// ȧ·q̇ while a is carried: ȧ leaves Π only, by −Σ_j v_j (u_jᵀḂa)/σ_j.
    fn bias(&self, k: usize, a: &SVector<f64, N>, screws: &Screws<N>, at: &Posture<'_, N>) -> f64 {
        let Ba = screws.rate(at.qdot) * a;
        let i = self.entries[k].index;
        let mut bias = 0.0;
        for j in (0..self.block.count).filter(|j| *j != i) {
            let sigma = self.block.sigma(j);
            let pushed = self.block.unscaled(j, self.length_m).dot(&Ba);
            bias -= pushed * sigma / (sigma * sigma + SQUARED_GAP) * self.block.v(j).dot(at.qdot);
        }
        bias
    }

    /// The target of a singular frame's second axis: the last joint's axis, or the one before it where ζ lies along that.
    fn towards(&self, at: &Posture<'_, N>, axis: &Vector3<f64>) -> Vector3<f64> {
        let z = at.terms.z[N - 1];
        if N < 2 || z.dot(axis).abs() < 0.9 {
            z
        } else {
            at.terms.z[N - 2]
        }
    }
}
