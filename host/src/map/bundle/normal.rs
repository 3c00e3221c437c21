//! Normal equations, and a step by them.
//!
//! # Model
//! Corners move with the cameras, and landmarks are eliminated while `V_ij` is that of the cameras; with `B = ∂[θ ρ]/∂[δφ δp]` the block of
//! the bodies is `B_iᵀ V_ij B_j`. Damping is Marquardt's, `μ` times the diagonal before elimination, of landmarks, planes and keyframes alike.

use nalgebra::{Matrix2, Matrix3, SMatrix, SVector, Vector2, Vector3};

use super::eliminate::back_substitute;
use super::planes::{PlaneBlocks, PlaneCoupling, PlaneRow};
use super::sparse::{Pose, Whole};
use super::views::{Row, from_world, residual, right_residual, right_row, rows};
use super::{Bundle, BundleError, BundleSettings, Landmark, LandmarkView};
use libella_core::factor::reprojection::PairGeometry;

/// Squared whitened residual charged for a landmark behind a camera that sees it, as in the estimator.
const BEHIND_CAMERA: f64 = 100.0;
/// Weight of the gauge beside what is known of the first keyframe.
const GAUGE_WEIGHT: f64 = 1e3;

/// What a pose has to do with a landmark.
pub(super) type Coupling = SMatrix<f64, 6, 3>;

/// The normal equations before elimination.
#[derive(Debug)]
pub(super) struct Normal {
    /// `½ Σ ρ`.
    pub cost: f64,
    /// `V_ii` and `b_i` of the cameras.
    cameras: Vec<(Pose, SVector<f64, 6>)>,
    /// `B_i`.
    pub camera_by_body: Vec<Pose>,
    /// What concerns single bodies and neighbours.
    own: Vec<Whole>,
    successors: Vec<Whole>,
    gradient: Vec<SVector<f64, 15>>,
    /// `V_pp` and `b_p` of the planes.
    planes: Vec<(Matrix2<f64>, Vector2<f64>)>,
    /// The landmarks that take part, and their views one after the other.
    pub landmarks: Vec<LandmarkNormal>,
    pub views: Vec<(usize, Coupling)>,
}

/// `C`, `g` and `W` of a landmark.
#[derive(Debug)]
pub(super) struct LandmarkNormal {
    pub index: usize,
    pub hessian: Matrix3<f64>,
    pub gradient: Vector3<f64>,
    pub views: std::ops::Range<usize>,
    pub on_plane: Option<(usize, PlaneCoupling)>,
}

/// A step and what the linear model says of it.
#[derive(Debug)]
pub(super) struct Step {
    pub keyframes: Vec<[f64; 15]>,
    /// By index.
    pub landmarks: Vec<(usize, Vector3<f64>)>,
    /// Offsets and headings.
    pub planes: Vec<[f64; 2]>,
    /// How far the cost should fall.
    pub predicted: f64,
}

#[cfg(test)]
impl Normal {
    /// Slopes of the cost along all keyframes, along the landmarks by index, and along the planes.
    #[allow(clippy::type_complexity)] // keyframes; landmarks by their index; planes
    pub fn gradients(&self) -> (Vec<SVector<f64, 15>>, Vec<(usize, Vector3<f64>)>, Vec<Vector2<f64>>) {
        let mut keyframes = self.gradient.clone();
        for ((gradient, by_body), (_, visual)) in keyframes.iter_mut().zip(&self.camera_by_body).zip(&self.cameras) {
            let seen = gradient.fixed_rows::<6>(0) + by_body.tr_mul(visual);
            gradient.fixed_rows_mut::<6>(0).copy_from(&seen);
        }
        let landmarks = self.landmarks.iter().map(|landmark| (landmark.index, landmark.gradient)).collect();
        (keyframes, landmarks, self.planes.iter().map(|(_, gradient)| *gradient).collect())
    }
}

/// Robust cost of a view, twice.
fn view_cost(pair: &PairGeometry<f64>, landmark: &Vector3<f64>, view: &LandmarkView, settings: &BundleSettings) -> f64 {
    let squared = residual(pair, landmark, &view.point).map_or(BEHIND_CAMERA, |residual| residual.norm_squared());
    let right = view.right.and_then(|right| right_residual(pair, landmark, &view.point, &right, right_camera(settings)));
    settings.kernel.rho(squared) + right.map_or(0.0, |residual| settings.kernel.rho(residual * residual))
}

fn right_camera(settings: &BundleSettings) -> (f64, f64) {
    (settings.virtual_baseline_m, settings.right_weight)
}

impl Bundle {
    /// `½ Σ ρ` at the present solution.
    pub fn cost(&self) -> f64 {
        let pairs: Vec<_> = self.camera_poses().iter().map(from_world).collect();
        let mut total = 0.0;
        for landmark in self.landmarks.iter().filter(|landmark| landmark.used) {
            for view in landmark.views.iter().filter(|view| view.used) {
                total += view_cost(&pairs[view.keyframe], &landmark.position_in_world, view, &self.settings);
            }
            if let Some((_, row)) = self.plane_row(landmark) {
                total += self.settings.kernel.rho(row.residual * row.residual);
            }
        }
        for (link, ends) in self.links.iter().zip(self.keyframes.windows(2)) {
            total += link.cost(&self.settings, &ends[0].state, &ends[1].state);
        }
        for keyframe in self.keyframes.iter().filter(|keyframe| keyframe.at_rest) {
            total += keyframe.state.velocity_in_world.norm_squared() / self.settings.rest_sigma_m_s.powi(2);
        }
        if let (Some((gyro, accel)), Some(first)) = (self.settings.first_bias_sigma, self.keyframes.first()) {
            let bias = &first.state.bias;
            total += bias.gyro_rad_s.norm_squared() / (gyro * gyro) + bias.accel_m_s2.norm_squared() / (accel * accel);
        }
        0.5 * total
    }

    /// Linearises all factors at the present solution.
    pub(super) fn linearize(&self) -> Normal {
        let count = self.keyframes.len();
        let cameras = self.camera_poses();
        let as_matrix = |rows: [[f64; 6]; 6]| Pose::from_fn(|r, c| rows[r][c]);
        let mut normal = Normal {
            cost: 0.0,
            cameras: vec![(Pose::zeros(), SVector::zeros()); count],
            camera_by_body: cameras.iter().map(|camera| as_matrix(self.mount.d_camera_d_body(camera))).collect(),
            own: vec![Whole::zeros(); count],
            successors: vec![Whole::zeros(); count - 1],
            gradient: vec![SVector::zeros(); count],
            planes: vec![(Matrix2::zeros(), Vector2::zeros()); self.planes.len()],
            landmarks: Vec::new(),
            views: Vec::new(),
        };
        let pairs: Vec<_> = cameras.iter().map(from_world).collect();
        for (index, landmark) in self.landmarks.iter().enumerate().filter(|(_, landmark)| landmark.used) {
            self.add_landmark(index, landmark, &pairs, &mut normal);
        }
        for (i, (link, ends)) in self.links.iter().zip(self.keyframes.windows(2)).enumerate() {
            let linear = link.linearize(&self.settings, &ends[0].state, &ends[1].state);
            let (from, to) = (&linear.d_residual_d_from, &linear.d_residual_d_to);
            normal.own[i] += from.tr_mul(from);
            normal.own[i + 1] += to.tr_mul(to);
            normal.successors[i] += to.tr_mul(from);
            normal.gradient[i] += from.tr_mul(&linear.residual);
            normal.gradient[i + 1] += to.tr_mul(&linear.residual);
            normal.cost += linear.residual.norm_squared();
        }
        self.add_single_states(&mut normal);
        normal.cost *= 0.5;
        normal
    }

    /// Rest and the first biases.
    fn add_single_states(&self, normal: &mut Normal) {
        let mut add = |i: usize, at: usize, value: &Vector3<f64>, sigma: f64| {
            let weight = (sigma * sigma).recip();
            for axis in 0..3 {
                normal.own[i][(at + axis, at + axis)] += weight;
                normal.gradient[i][at + axis] += weight * value[axis];
            }
            normal.cost += weight * value.norm_squared();
        };
        for (i, keyframe) in self.keyframes.iter().enumerate().filter(|(_, keyframe)| keyframe.at_rest) {
            add(i, 6, &keyframe.state.velocity_in_world, self.settings.rest_sigma_m_s);
        }
        if let (Some((gyro, accel)), Some(first)) = (self.settings.first_bias_sigma, self.keyframes.first()) {
            add(0, 9, &first.state.bias.gyro_rad_s, gyro);
            add(0, 12, &first.state.bias.accel_m_s2, accel);
        }
    }

    fn add_landmark(&self, index: usize, landmark: &Landmark, pairs: &[PairGeometry<f64>], normal: &mut Normal) {
        let (settings, kernel) = (&self.settings, &self.settings.kernel);
        let at = &landmark.position_in_world;
        let (mut hessian, mut gradient) = (Matrix3::zeros(), Vector3::zeros());
        let begin = normal.views.len();
        for view in landmark.views.iter().filter(|view| view.used) {
            let pair = &pairs[view.keyframe];
            normal.cost += view_cost(pair, at, view, settings);
            let Some([x, y]) = rows(pair, at, &view.point) else { continue };
            let weight = kernel.weight(x.residual * x.residual + y.residual * y.residual);
            let mut coupling = Coupling::zeros();
            let camera = &mut normal.cameras[view.keyframe];
            let mut add = |row: &Row, weight: f64| {
                let (by_camera, by_point) = (SVector::from(row.by_camera), Vector3::from(row.by_point));
                let (weighted_camera, weighted_point) = (by_camera * weight, by_point * weight);
                hessian += weighted_point * by_point.transpose();
                gradient += weighted_point * row.residual;
                coupling += weighted_camera * by_point.transpose();
                camera.0 += weighted_camera * by_camera.transpose();
                camera.1 += weighted_camera * row.residual;
            };
            add(&x, weight);
            add(&y, weight);
            let right = view.right.and_then(|right| right_row(pair, at, &view.point, &right, right_camera(settings)));
            if let Some(row) = right {
                add(&row, kernel.weight(row.residual * row.residual));
            }
            normal.views.push((view.keyframe, coupling));
        }
        let on_plane = self.plane_row(landmark).map(|(plane, row)| {
            let weight = kernel.weight(row.residual * row.residual);
            let weighted = row.by_plane * weight;
            hessian += row.by_point * row.by_point.transpose() * weight;
            gradient += row.by_point * (row.residual * weight);
            let (own, slope) = &mut normal.planes[plane];
            *own += weighted * row.by_plane.transpose();
            *slope += weighted * row.residual;
            normal.cost += kernel.rho(row.residual * row.residual);
            (plane, weighted * row.by_point.transpose())
        });
        normal.landmarks.push(LandmarkNormal { index, hessian, gradient, views: begin..normal.views.len(), on_plane });
    }

    /// The row of a landmark that no camera is in, and its plane.
    fn plane_row(&self, landmark: &Landmark) -> Option<(usize, PlaneRow)> {
        let plane = landmark.plane?;
        Some((plane, self.planes.get(plane)?.row(&landmark.position_in_world, &self.settings)))
    }

    /// Solves `(H + μ diag H) δ = −b`; `None` where that has no solution.
    pub(super) fn step(&self, normal: &Normal, damping: f64) -> Result<Option<Step>, BundleError> {
        let count = self.keyframes.len();
        let mut band = self.structure.empty_band();
        let mut reduced: Vec<_> = normal.cameras.iter().map(|(_, gradient)| *gradient).collect();
        for (i, (block, _)) in normal.cameras.iter().enumerate() {
            band.0[self.structure.place(i, i)] = *block;
        }
        let (mut planes, plane_diagonals) = PlaneBlocks::new(count, &normal.planes, damping);
        let eliminated = self.eliminate(normal, damping, &mut band, &mut reduced, &mut planes);
        planes.turn_to_bodies(&normal.camera_by_body);

        let to_body = |i: usize, j: usize, block: &Pose| normal.camera_by_body[i].tr_mul(&(block * normal.camera_by_body[j]));
        let (mut own, mut successors) = (normal.own.clone(), normal.successors.clone());
        let (mut diagonals, mut gradients) = (Vec::with_capacity(count), normal.gradient.clone());
        let mut right = vec![0.0; 15 * count];
        for i in 0..count {
            let mut diagonal = normal.own[i].diagonal();
            let before = to_body(i, i, &normal.cameras[i].0).diagonal();
            let whole = diagonal.fixed_rows::<6>(0) + before;
            diagonal.fixed_rows_mut::<6>(0).copy_from(&whole);
            let block = own[i].fixed_view::<6, 6>(0, 0) + to_body(i, i, &band.0[self.structure.place(i, i)]);
            own[i].fixed_view_mut::<6, 6>(0, 0).copy_from(&block);
            for (k, value) in diagonal.iter().enumerate() {
                own[i][(k, k)] += damping * value;
            }
            let visual = normal.camera_by_body[i].tr_mul(&reduced[i]);
            for (k, slot) in right[15 * i..15 * i + 15].iter_mut().enumerate() {
                *slot = -normal.gradient[i][k] - visual.get(k).copied().unwrap_or(0.0);
            }
            let seen = gradients[i].fixed_rows::<6>(0) + normal.camera_by_body[i].tr_mul(&normal.cameras[i].1);
            gradients[i].fixed_rows_mut::<6>(0).copy_from(&seen);
            diagonals.push(diagonal);
        }
        self.fix_gauge(&mut own[0], &diagonals[0]);
        for j in 0..count {
            for i in j + 1..count.min(j + self.structure.blocks(j)) {
                let at = self.structure.place(i, j);
                band.0[at] = to_body(i, j, &band.0[at]);
            }
            if let Some(successor) = successors.get_mut(j).filter(|_| self.structure.blocks(j) > 1) {
                let block = successor.fixed_view::<6, 6>(0, 0) + band.0[self.structure.place(j + 1, j)];
                successor.fixed_view_mut::<6, 6>(0, 0).copy_from(&block);
            }
        }
        right.extend(planes.gradient.iter().flat_map(|gradient| [-gradient.x, -gradient.y]));
        if !self.structure.solve(&own, &successors, &band, &planes, &mut right)? {
            return Ok(None);
        }
        let mut keyframes = vec![[0.0; 15]; count];
        let (of_keyframes, of_planes) = right.split_at(15 * count);
        keyframes.as_flattened_mut().copy_from_slice(of_keyframes);
        let (plane_steps, _) = of_planes.as_chunks::<2>();
        let mut predicted = 0.0;
        for (step, (gradient, diagonal)) in keyframes.iter().zip(gradients.iter().zip(&diagonals)) {
            for (value, (slope, curvature)) in step.iter().zip(gradient.iter().zip(diagonal.iter())) {
                predicted += value * (damping * curvature * value - slope);
            }
        }
        for (step, ((_, gradient), diagonal)) in plane_steps.iter().zip(normal.planes.iter().zip(&plane_diagonals)) {
            let step = Vector2::from(*step);
            predicted += step.dot(&(diagonal.component_mul(&step) - gradient));
        }
        let landmarks = back_substitute(normal, &eliminated, &keyframes, plane_steps);
        for (landmark, (_, step)) in normal.landmarks.iter().zip(&landmarks) {
            let damped = landmark.hessian.diagonal().component_mul(step) * damping - landmark.gradient;
            predicted += step.dot(&damped);
        }
        Ok(Some(Step { keyframes, landmarks, planes: plane_steps.to_vec(), predicted: 0.5 * predicted }))
    }

    /// The first position and heading stay.
    fn fix_gauge(&self, own: &mut Whole, diagonal: &SVector<f64, 15>) {
        let vertical = self.keyframes[0].state.world_from_body.inverse() * Vector3::z();
        let (turn, shift) = (diagonal.fixed_rows::<3>(0).max(), diagonal.fixed_rows::<3>(3).max());
        for r in 0..3 {
            for c in 0..3 {
                own[(r, c)] += GAUGE_WEIGHT * turn * vertical[r] * vertical[c];
            }
            own[(3 + r, 3 + r)] += GAUGE_WEIGHT * shift;
        }
    }
}
