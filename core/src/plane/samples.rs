//! The points that planes are sought among, laid out for scanning.
//!
//! # Model
//! Points and normals are turned into a level frame `L`, whose z axis is up, as they come in:
//! ```text
//! x_L = R_LW x_W        R_LW = [b₁ b₂ up]ᵀ, the identity where up is the world's z axis
//! ```
//! Then a horizontal plane is one number and a vertical one three. A structure of arrays, ordered by what a normal allows (a horizontal
//! plane, a vertical one, neither, or no normal at all) and by the source: each solver's candidates are one run of the arrays with few
//! weights, so that a scan needs no look at the weight, and one for a horizontal plane none at the normal.
//!
//! Map points weigh 1, points of a depth map ½, and these are drawn with the probability `1 − u` of their uncertainty `u`.

// A comparison that NaN must fail is written as the negation of what must hold.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

use core::ops::Range;

use nalgebra::{Matrix3, UnitVector3, Vector3};

use crate::lie::s2;
use crate::real::Real;

/// Coordinates beyond this are refused, m: in single precision they are known to millimetres only, and squares of them sum up badly.
pub const GREATEST_COORDINATE_M: f64 = 1e4;

/// What a point of a depth map weighs beside one of the map.
const DEPTH_WEIGHT: f64 = 0.5;

/// Where a point comes from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Source<T: Real> {
    /// A landmark: weight 1.
    MapPoint,
    /// A depth map: weight ½.
    Depth {
        /// `u`, in [0, 1]: 0 is certain.
        uncertainty: T,
    },
}

impl<T: Real> Source<T> {
    /// What such a point counts beside others.
    #[must_use]
    pub fn weight(&self) -> T {
        match self {
            Self::MapPoint => T::one(),
            Self::Depth { .. } => T::of(DEPTH_WEIGHT),
        }
    }
}

/// A point that may lie on a plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample<T: Real> {
    /// m.
    pub point_in_world: Vector3<T>,
    /// The normal of the surface there, of any length and sign, if known; one without direction counts as unknown.
    pub normal_in_world: Option<Vector3<T>>,
    /// Where it comes from.
    pub source: Source<T>,
}

/// Why a sample was not taken. Nothing has changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum SampleError {
    /// There are as many as fit.
    Full,
    /// A coordinate is not a number or beyond [`GREATEST_COORDINATE_M`].
    Coordinate,
    /// An uncertainty is not in [0, 1].
    Uncertainty,
}

impl core::fmt::Display for SampleError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Full => "no room for another sample",
            Self::Coordinate => "the sample is not finite or too far from the origin",
            Self::Uncertainty => "the uncertainty of the sample is not in [0, 1]",
        })
    }
}

impl core::error::Error for SampleError {}

// Groups, in the order of the arrays: twice what the normal allows, plus the source.
const LEVEL: usize = 0;
const UNKNOWN: usize = 2;
const UPRIGHT: usize = 4;
const TILTED: usize = 6;
const OF_DEPTH: usize = 1;
/// No candidate any more: set beside the group, and a group of its own at the end of the arrays.
const TAKEN: u8 = 8;
const GROUPS: usize = 9;

/// Owned by no plane.
const NOBODY: u8 = u8::MAX;

/// At most `N` samples: `24 N` bytes in single precision for points and normals, and `5 N` beside them.
#[derive(Debug, Clone)]
pub struct Samples<T: Real, const N: usize> {
    level_from_world: Matrix3<T>,
    cosine_tolerance: T,
    sine_tolerance: T,
    columns: [[T; N]; 6],
    chance: [u8; N],
    group: [u8; N],
    /// Which sample, by the order of arrival, stands here.
    arrival: [u16; N],
    /// The plane of each sample, by the order of arrival.
    owner: [u8; N],
    /// Where each group begins, and the end.
    starts: [u16; GROUPS + 1],
    len: usize,
    is_arranged: bool,
}

/// The samples without their number in the type.
#[derive(Clone, Copy)]
pub(super) struct View<'a, T: Real> {
    /// x, y, z and the normal, zero if unknown, in the level frame.
    pub columns: [&'a [T]; 6],
    pub chance: &'a [u8],
    pub starts: &'a [u16; GROUPS + 1],
    pub level_from_world: &'a Matrix3<T>,
    pub cosine_tolerance: T,
}

/// Samples in a row with one weight, all with normals or none.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Run<T> {
    pub range: Range<usize>,
    pub weight: T,
    /// Whether they have normals that may be wrong for the plane.
    pub checks_normals: bool,
    pub has_normals: bool,
}

/// What a solver scans: groups in a row, of which those before `checked` are asked for no normal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Candidates {
    /// Normal up, or unknown.
    Horizontal,
    /// Normal level, or unknown.
    Vertical,
    /// All.
    Any,
}

impl<T: Real, const N: usize> Samples<T, N> {
    /// Without samples; `normal_tolerance_rad` is what a normal may differ from that of a plane it agrees with.
    #[must_use]
    pub fn new(up_in_world: &UnitVector3<T>, normal_tolerance_rad: T) -> Self {
        const { assert!(N < u16::MAX as usize) }
        let level = s2::tangent_basis(up_in_world);
        let up = up_in_world.into_inner();
        let level_from_world = Matrix3::from_columns(&[level.column(0).into(), level.column(1).into(), up]).transpose();
        // The Householder basis has the other hand below the horizon; planes do not care which.
        let (sine_tolerance, cosine_tolerance) = normal_tolerance_rad.sine_cosine();
        Self {
            level_from_world,
            cosine_tolerance,
            sine_tolerance,
            columns: [[T::ZERO; N]; 6],
            chance: [0; N],
            group: [0; N],
            arrival: [0; N],
            owner: [NOBODY; N],
            starts: [0; GROUPS + 1],
            len: 0,
            is_arranged: true,
        }
    }

    /// Forgets all samples.
    pub fn clear(&mut self) {
        self.len = 0;
        self.starts = [0; GROUPS + 1];
        self.is_arranged = true;
    }

    /// How many samples there are.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.len
    }

    /// Whether there are none.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Takes a sample in.
    ///
    /// # Errors
    /// No room, or not a usable sample.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    pub fn push(&mut self, sample: &Sample<T>) -> Result<(), SampleError> {
        if self.len == N {
            return Err(SampleError::Full);
        }
        if !sample.point_in_world.iter().all(|x| x.abs() <= T::of(GREATEST_COORDINATE_M)) {
            return Err(SampleError::Coordinate);
        }
        let (chance, source) = match sample.source {
            Source::MapPoint => (u8::MAX, 0),
            Source::Depth { uncertainty } if uncertainty >= T::ZERO && uncertainty <= T::one() => {
                ((255.0 * (1.0 - uncertainty.as_f64())) as u8, OF_DEPTH)
            }
            Source::Depth { .. } => return Err(SampleError::Uncertainty),
        };
        let point = self.level_from_world * sample.point_in_world;
        let normal = sample.normal_in_world.map(|normal| (normal, normal.norm_squared().root()));
        let normal = normal.filter(|(_, length)| *length > T::of(1e-6) && length.is_usable());
        let normal = normal.map(|(normal, length)| self.level_from_world * (normal / length));
        let allows = match normal {
            None => UNKNOWN,
            Some(normal) if normal.z.abs() >= self.cosine_tolerance => LEVEL,
            Some(normal) if normal.z.abs() <= self.sine_tolerance => UPRIGHT,
            Some(_) => TILTED,
        };
        let normal = normal.unwrap_or_else(Vector3::zeros);
        let place = self.len;
        for (column, value) in self.columns.iter_mut().zip(point.iter().chain(normal.iter())) {
            column[place] = *value;
        }
        self.chance[place] = chance;
        self.group[place] = (allows + source) as u8;
        self.arrival[place] = place as u16;
        self.owner[place] = NOBODY;
        self.len += 1;
        self.is_arranged = false;
        Ok(())
    }

    /// Which of the planes found in the last detection the sample that came `arrival`-th lies on, by their order.
    #[must_use]
    pub fn plane_of(&self, arrival: usize) -> Option<usize> {
        let owner = *self.owner.get(..self.len)?.get(arrival)?;
        (owner != NOBODY).then_some(usize::from(owner))
    }

    /// Makes every sample a candidate again.
    pub(super) fn release(&mut self) {
        for group in &mut self.group[..self.len] {
            *group &= !TAKEN;
        }
        self.owner[..self.len].fill(NOBODY);
        self.is_arranged = false;
    }

    /// Orders the arrays by group: in-place permutation along its cycles, every sample moves at most once.
    #[allow(clippy::cast_possible_truncation)]
    pub(super) fn arrange(&mut self) {
        if self.is_arranged {
            return;
        }
        let mut counts = [0_usize; GROUPS];
        for group in &self.group[..self.len] {
            counts[usize::from((*group).min(TAKEN))] += 1;
        }
        let mut next = [0; GROUPS];
        let mut start = 0;
        for ((first, next), count) in self.starts.iter_mut().zip(&mut next).zip(counts) {
            *first = start as u16; // N < 2¹⁶
            *next = start;
            start += count;
        }
        self.starts[GROUPS] = start as u16;
        for group in 0..GROUPS {
            let end = usize::from(self.starts[group + 1]);
            while next[group] < end {
                let place = next[group];
                let home = usize::from(self.group[place].min(TAKEN));
                if home != group {
                    self.swap(place, next[home]);
                }
                next[home] += 1;
            }
        }
        self.is_arranged = true;
    }

    fn swap(&mut self, a: usize, b: usize) {
        for column in &mut self.columns {
            column.swap(a, b);
        }
        self.chance.swap(a, b);
        self.group.swap(a, b);
        self.arrival.swap(a, b);
    }

    /// Takes the candidates on a surface out, for a plane or for nobody; how many there were.
    pub(super) fn take(&mut self, candidates: Candidates, plane: Option<u8>, mut is_on: impl FnMut([T; 6]) -> bool) -> usize {
        debug_assert!(self.is_arranged);
        let mut taken = 0;
        for place in candidates.range(&self.starts) {
            if is_on(self.columns.each_ref().map(|column| column[place])) {
                self.group[place] |= TAKEN;
                self.owner[usize::from(self.arrival[place])] = plane.unwrap_or(NOBODY);
                taken += 1;
            }
        }
        self.is_arranged = false;
        taken
    }

    pub(super) fn view(&self) -> View<'_, T> {
        debug_assert!(self.is_arranged);
        View {
            columns: self.columns.each_ref().map(|column| &column[..self.len]),
            chance: &self.chance[..self.len],
            starts: &self.starts,
            level_from_world: &self.level_from_world,
            cosine_tolerance: self.cosine_tolerance,
        }
    }
}

impl Candidates {
    const fn groups(self) -> Range<usize> {
        match self {
            Self::Horizontal => LEVEL..UPRIGHT,
            Self::Vertical => UNKNOWN..TILTED,
            Self::Any => LEVEL..TAKEN as usize,
        }
    }

    fn range(self, starts: &[u16; GROUPS + 1]) -> Range<usize> {
        usize::from(starts[self.groups().start])..usize::from(starts[self.groups().end])
    }
}

impl<T: Real> View<'_, T> {
    /// Where the candidates stand.
    pub fn range(&self, candidates: Candidates) -> Range<usize> {
        candidates.range(self.starts)
    }

    /// The candidates in rows of one weight. Of those for a horizontal plane no normal has to be asked: the group tells.
    pub fn runs(&self, candidates: Candidates) -> impl Iterator<Item = Run<T>> {
        candidates.groups().map(move |group| Run {
            range: usize::from(self.starts[group])..usize::from(self.starts[group + 1]),
            weight: if group % 2 == OF_DEPTH { T::of(DEPTH_WEIGHT) } else { T::one() },
            checks_normals: candidates != Candidates::Horizontal && !(UNKNOWN..UPRIGHT).contains(&group),
            has_normals: !(UNKNOWN..UPRIGHT).contains(&group),
        })
    }

    /// What the candidates weigh.
    pub fn weight(&self, candidates: Candidates) -> T {
        #[allow(clippy::cast_precision_loss)]
        self.runs(candidates).fold(T::ZERO, |sum, run| sum + run.weight * T::of(run.range.len() as f64))
    }

    pub fn point(&self, place: usize) -> Vector3<T> {
        Vector3::new(self.columns[0][place], self.columns[1][place], self.columns[2][place])
    }

    /// Point and normal, the latter zero if unknown.
    pub fn row(&self, place: usize) -> [T; 6] {
        self.columns.map(|column| column[place])
    }
}
