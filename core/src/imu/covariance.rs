//! The covariance of a preintegrated interval, as blocks.
//!
//! # Model
//! The error is kept in the START frame, rotation on the left: `ΔR_true = Exp(θ) ΔR`, `Δv_true = Δv + δv`,
//! `Δp_true = Δp + δp`, biases `b_true = b + (g, a)`. Over one interval, with `u = M a Δt` the velocity gained,
//! `M` the attitude at its middle, `A = −Δt M S` and `C = −Δt M`,
//! ```text
//! θₘ = θ + ½ A g             θ' = θ + A g                     gyro noise σ_g² Δt I: half before, half after
//! v' = v − [u]× θₘ + C a     p' = p + Δt/2 (v + v')           accel noise σ_a² (Δt, Δt²/2, Δt³/3) on (vv, vp, pp)
//! g' = g,  a' = a                                             walks σ_w² Δt I: half before, half after
//! ```
//! In this form θ carries over unchanged and all noise stays isotropic, so that three of the five diagonal blocks need no product,
//! and `cov(θ,a) = cov(g,a) = 0`, `cov(g,g)` and `cov(a,a)` are multiples of I. Half before, half after is the trapezoidal rule for the
//! integral of the noise: it keeps the matrix positive definite from the first sample on.
//!
//! Second-order quantities inside one interval are simplified here and only here (never in the bias Jacobians): `A Aᵀ ≈ Δt² I` and θₘ as
//! the mean of θ and θ'. Both are exact for a body that does not turn, and off by the order of (angle per sample) / (samples) else.

use nalgebra::{Matrix3, SMatrix, Vector3};

use super::ImuNoise;
use crate::lie::matrix::{block, diagonal, product, put, sum};
use crate::lie::so3;
use crate::real::Real;

/// Blocks of the covariance of `[θ v p g a]`, 3×3 each; those not named are zero or a transpose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ErrorCovariance<T: Real> {
    tt: Matrix3<T>,
    tv: Matrix3<T>,
    tp: Matrix3<T>,
    tg: Matrix3<T>,
    vv: Matrix3<T>,
    vp: Matrix3<T>,
    vg: Matrix3<T>,
    va: Matrix3<T>,
    pp: Matrix3<T>,
    pg: Matrix3<T>,
    pa: Matrix3<T>,
    /// `cov(g,g) = gg I`.
    gg: T,
    /// `cov(a,a) = aa I`.
    aa: T,
}

/// The derivatives of one interval, see the module.
pub(super) struct Transition<T: Real> {
    pub dt: T,
    /// `u`, m/s.
    pub velocity_gain: Vector3<T>,
    /// `A`.
    pub rotation_by_gyro: Matrix3<T>,
    /// `C`.
    pub velocity_by_accel: Matrix3<T>,
}

impl<T: Real> ErrorCovariance<T> {
    pub fn zero() -> Self {
        let o = Matrix3::zeros();
        Self { tt: o, tv: o, tp: o, tg: o, vv: o, vp: o, vg: o, va: o, pp: o, pg: o, pa: o, gg: T::ZERO, aa: T::ZERO }
    }

    /// One sampling interval. Names: `e_x = cov(A g, x)`, `k_x = cov(C a, x)`, a trailing 1 is the value after the interval.
    #[inline]
    pub fn propagate(&mut self, step: &Transition<T>, noise: &ImuNoise<T>) {
        let Transition { dt, velocity_gain: u, rotation_by_gyro: by_gyro, velocity_by_accel: by_accel } = step;
        let (dt, half) = (*dt, T::of(0.5));
        let half_dt = dt * half;
        let white = |density: T| density * density * dt;
        let gyro_half = white(noise.gyro_noise_density) * half;
        let accel = white(noise.accel_noise_density);
        let gyro_walk_half = white(noise.gyro_random_walk) * half;
        let accel_walk_half = white(noise.accel_random_walk) * half;

        let tt = add_diagonal(self.tt, gyro_half);
        let gg = self.gg + gyro_walk_half;
        let aa = self.aa + accel_walk_half;
        let inner_gg = gg * dt * dt; // cov(A g, A g) = inner_gg I

        let e_t = times_transposed(by_gyro, &self.tg);
        let e_v = times_transposed(by_gyro, &self.vg);
        let e_p = times_transposed(by_gyro, &self.pg);
        let k_v = times_transposed(by_accel, &self.va);
        let k_p = times_transposed(by_accel, &self.pa);

        // v' = v − [u]× θₘ + C a against the old variables
        let v1t = self.tv.transpose() - left_cross(u, &(tt + e_t * half));
        let v1v = self.vv - left_cross(u, &(self.tv + e_v * half)) + k_v;
        let v1p = self.vp - left_cross(u, &(self.tp + e_p * half)) + k_p;
        let vg1 = self.vg - left_cross(u, &(self.tg + by_gyro * (gg * half)));
        let va1 = self.va + by_accel * aa;
        let e_v1 = e_v + right_cross(&add_diagonal(e_t, inner_gg * half), u);
        let vv1 = v1v + right_cross(&(v1t + e_v1.transpose() * half), u) + k_v.transpose();
        let vv1 = mirror(&add_diagonal(vv1, aa * dt * dt + accel));

        // p' = p + Δt/2 (v + v')
        let tp1 = self.tp + (self.tv + v1t.transpose()) * half_dt;
        let e_p1 = e_p + (e_v + e_v1) * half_dt;
        let moved = self.vp + v1p + (self.vv + v1v * T::of(2.0) + vv1) * (half_dt * half);
        let pp1 = mirror(&(self.pp + (moved + moved.transpose()) * half_dt));
        self.pp = add_diagonal(pp1, accel * dt * dt * T::of(1.0 / 12.0));
        self.vp = v1p + (v1v + vv1) * half_dt;
        self.pg += (self.vg + vg1) * half_dt;
        self.pa += (self.va + va1) * half_dt;

        // θ' = θ + A g
        self.tt = add_diagonal(mirror(&(tt + e_t + e_t.transpose())), inner_gg + gyro_half);
        self.tv = v1t.transpose() + e_v1;
        self.tp = tp1 + e_p1;
        self.tg += by_gyro * gg;
        self.vv = vv1;
        self.vg = vg1;
        self.va = va1;
        self.gg = gg + gyro_walk_half;
        self.aa = aa + accel_walk_half;
    }

    /// `F self Fᵀ + Q later Qᵀ`, both 15×15 in the order `[θ p v g a]`. `F` has the structure of a transition and `Q` turns the later
    /// start frame into this one (`rotation`, biases apart).
    pub fn compose(&self, transition: &SMatrix<T, 15, 15>, rotation: &Matrix3<T>, later: &Self) -> Self {
        let dense = product(&product(transition, &self.dense(&Matrix3::identity())), &transition.transpose());
        let inverse = rotation.transpose();
        let plus = |row: usize, column: usize, m: &Matrix3<T>| sum(&block(&dense, row, column), m);
        let both = |row: usize, column: usize, m: &Matrix3<T>| plus(row, column, &product(&product(rotation, m), &inverse));
        let left = |row: usize, column: usize, m: &Matrix3<T>| plus(row, column, &product(rotation, m));
        Self {
            tt: mirror(&both(0, 0, &later.tt)),
            tv: both(0, 6, &later.tv),
            tp: both(0, 3, &later.tp),
            tg: left(0, 9, &later.tg),
            vv: mirror(&both(6, 6, &later.vv)),
            vp: both(6, 3, &later.vp),
            vg: left(6, 9, &later.vg),
            va: left(6, 12, &later.va),
            pp: mirror(&both(3, 3, &later.pp)),
            pg: left(3, 9, &later.pg),
            pa: left(3, 12, &later.pa),
            gg: self.gg + later.gg,
            aa: self.aa + later.aa,
        }
    }

    /// The whole matrix, order `[φ p v g a]`, with `φ = turn θ`.
    pub fn dense(&self, turn: &Matrix3<T>) -> SMatrix<T, 15, 15> {
        let mut dense = SMatrix::<T, 15, 15>::zeros();
        let mut put = |row: usize, column: usize, block: &Matrix3<T>| {
            put(&mut dense, row, column, block);
            if row != column {
                put(&mut dense, column, row, &block.transpose());
            }
        };
        put(0, 0, &mirror(&product(&product(turn, &self.tt), &turn.transpose())));
        put(0, 3, &product(turn, &self.tp));
        put(0, 6, &product(turn, &self.tv));
        put(0, 9, &product(turn, &self.tg));
        put(3, 3, &self.pp);
        put(3, 6, &self.vp.transpose());
        put(3, 9, &self.pg);
        put(3, 12, &self.pa);
        put(6, 6, &self.vv);
        put(6, 9, &self.vg);
        put(6, 12, &self.va);
        put(9, 9, &Matrix3::from_diagonal_element(self.gg));
        put(12, 12, &Matrix3::from_diagonal_element(self.aa));
        dense
    }
}

/// `a bᵀ`.
#[inline(always)]
fn times_transposed<T: Real>(a: &Matrix3<T>, b: &Matrix3<T>) -> Matrix3<T> {
    let ([a0, a1, a2], [b0, b1, b2]) = (a.data.0, b.data.0);
    let entry = |row: usize, column: usize| a0[row] * b0[column] + a1[row] * b1[column] + a2[row] * b2[column];
    columns(entry)
}

/// `[u]× m`.
#[inline(always)]
fn left_cross<T: Real>(u: &Vector3<T>, m: &Matrix3<T>) -> Matrix3<T> {
    let c = m.data.0;
    let column = |k: usize| [u.y * c[k][2] - u.z * c[k][1], u.z * c[k][0] - u.x * c[k][2], u.x * c[k][1] - u.y * c[k][0]];
    matrix([column(0), column(1), column(2)])
}

/// `m [u]×`.
#[inline(always)]
fn right_cross<T: Real>(m: &Matrix3<T>, u: &Vector3<T>) -> Matrix3<T> {
    let [c0, c1, c2] = m.data.0;
    let mix = |p: &[T; 3], by: T, q: &[T; 3], less: T| [p[0] * by - q[0] * less, p[1] * by - q[1] * less, p[2] * by - q[2] * less];
    matrix([mix(&c1, u.z, &c2, u.y), mix(&c2, u.x, &c0, u.z), mix(&c0, u.y, &c1, u.x)])
}

/// The symmetric matrix with the upper triangle of `m`.
#[inline(always)]
fn mirror<T: Real>(m: &Matrix3<T>) -> Matrix3<T> {
    Matrix3::new(m.m11, m.m12, m.m13, m.m12, m.m22, m.m23, m.m13, m.m23, m.m33)
}

#[inline(always)]
fn add_diagonal<T: Real>(mut m: Matrix3<T>, value: T) -> Matrix3<T> {
    m.m11 += value;
    m.m22 += value;
    m.m33 += value;
    m
}

#[inline(always)]
fn columns<T: Real>(entry: impl Fn(usize, usize) -> T) -> Matrix3<T> {
    let column = |k: usize| [entry(0, k), entry(1, k), entry(2, k)];
    matrix([column(0), column(1), column(2)])
}

#[inline(always)]
fn matrix<T: Real>(columns: [[T; 3]; 3]) -> Matrix3<T> {
    Matrix3::from_data(nalgebra::ArrayStorage(columns))
}

/// `F` of an interval that starts where another one ends, order `[θ p v g a]`, all in the frame of the first start: `later_v`, `later_p` its
/// turned deltas and `d_*` its turned bias Jacobians.
#[inline(never)]
pub(super) fn transition<T: Real>(
    span: T,
    [later_v, later_p]: [&Vector3<T>; 2],
    d_rotation: &Matrix3<T>,
    [d_position_d_gyro, d_position_d_accel]: [&Matrix3<T>; 2],
    [d_velocity_d_gyro, d_velocity_d_accel]: [&Matrix3<T>; 2],
) -> SMatrix<T, 15, 15> {
    let mut f: SMatrix<T, 15, 15> = diagonal(core::iter::repeat(T::one()));
    let mut put = |row: usize, column: usize, block: &Matrix3<T>| put(&mut f, row, column, block);
    put(0, 9, d_rotation);
    put(3, 0, &-so3::hat(later_p));
    put(3, 6, &Matrix3::from_diagonal_element(span));
    put(3, 9, d_position_d_gyro);
    put(3, 12, d_position_d_accel);
    put(6, 0, &-so3::hat(later_v));
    put(6, 9, d_velocity_d_gyro);
    put(6, 12, d_velocity_d_accel);
    f
}
