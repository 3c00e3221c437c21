//! What a few samples determine: the models of [`crate::robust::ransac`].

use nalgebra::Vector3;

use super::scan::{Level, Limits, Surface, Tilted, Upright, agreement};
use crate::plane::samples::View;
use crate::real::Real;
use crate::robust::ransac::{Agreement, Generator, SampleModel};

/// One point of a horizontal plane.
pub(super) struct OnePoint<'a, T: Real> {
    pub view: View<'a, T>,
    pub limits: Limits<T>,
}

/// Two points of a vertical plane, apart by at least `least_separation_m` horizontally.
pub(super) struct TwoPoints<'a, T: Real> {
    pub view: View<'a, T>,
    pub limits: Limits<T>,
    pub least_separation_m: T,
}

/// One point of a vertical plane with a known normal.
pub(super) struct OnePointOnWall<'a, T: Real> {
    pub view: View<'a, T>,
    pub limits: Limits<T>,
    pub normal: [T; 2],
}

/// Three points, off a common line by at least `least_separation_m`.
pub(super) struct ThreePoints<'a, T: Real> {
    pub view: View<'a, T>,
    pub limits: Limits<T>,
    pub least_separation_m: T,
}

/// What all four have in common; `$fit` is the model through a sample.
macro_rules! sample_model {
    ($items:ident, $count:literal, $surface:ty, |$self:ident, $sample:ident| $fit:expr) => {
        impl<T: Real> SampleModel<T, $count> for $items<'_, T> {
            type Model = $surface;

            fn count(&self) -> usize {
                self.view.range(<$surface>::CANDIDATES).len()
            }

            fn fit(&$self, sample: &[usize; $count]) -> Option<$surface> {
                let first = $self.view.range(<$surface>::CANDIDATES).start;
                let $sample = sample.map(|item| first + item);
                let surface: $surface = $fit?;
                // A sample whose own normals disagree is not clean.
                $sample.iter().all(|place| $self.limits.admit(&surface, $self.view.row(*place))).then_some(surface)
            }

            fn squared_distance(&self, model: &$surface, item: usize) -> T {
                let row = self.view.row(self.view.range(<$surface>::CANDIDATES).start + item);
                if !self.limits.admit(model, row) {
                    return T::one();
                }
                let distance = model.distance_m([row[0], row[1], row[2]]);
                distance * distance / self.limits.squared_distance
            }

            fn weight(&self, item: usize) -> T {
                let place = self.view.range(<$surface>::CANDIDATES).start + item;
                self.view.runs(<$surface>::CANDIDATES).find(|run| run.range.contains(&place)).map_or(T::ZERO, |run| run.weight)
            }

            fn draw(&self, generator: &mut Generator) -> usize {
                let range = self.view.range(<$surface>::CANDIDATES);
                let mut item = 0;
                for _ in 0..32 {
                    item = generator.below(range.len());
                    let chance = self.view.chance[range.start + item];
                    if chance == u8::MAX || generator.below(255) < usize::from(chance) {
                        break;
                    }
                }
                item
            }

            fn total_weight(&self) -> T {
                self.view.weight(<$surface>::CANDIDATES)
            }

            fn agreement(&self, model: &$surface, to_beat: T) -> Option<Agreement<T>> {
                agreement(&self.view, model, &self.limits, to_beat)
            }
        }
    };
}

sample_model!(OnePoint, 1, Level<T>, |self, sample| { Some(Level { offset_m: -self.view.columns[2][sample[0]] }) });

sample_model!(TwoPoints, 2, Upright<T>, |self, sample| {
    let [a, b] = sample.map(|place| self.view.point(place));
    upright_through(&a, &b, self.least_separation_m)
});

sample_model!(OnePointOnWall, 1, Upright<T>, |self, sample| {
    let point = self.view.point(sample[0]);
    Some(Upright { normal: self.normal, offset_m: -(self.normal[0] * point.x + self.normal[1] * point.y) })
});

sample_model!(ThreePoints, 3, Tilted<T>, |self, sample| {
    let [a, b, c] = sample.map(|place| self.view.point(place));
    tilted_through(&a, &b, &c, self.least_separation_m)
});

/// `n ∝ (b − a) × e_z`: nothing, where the points lie above each other.
fn upright_through<T: Real>(a: &Vector3<T>, b: &Vector3<T>, least_separation_m: T) -> Option<Upright<T>> {
    let (along_x, along_y) = (b.x - a.x, b.y - a.y);
    let length = (along_x * along_x + along_y * along_y).root();
    if length < least_separation_m || length <= T::ZERO {
        return None;
    }
    let normal = [along_y / length, -along_x / length];
    Some(Upright { normal, offset_m: -(normal[0] * a.x + normal[1] * a.y) })
}

/// `n ∝ (b − a) × (c − a)`: nothing, where the third is close to the line of the others, whichever is called third.
fn tilted_through<T: Real>(a: &Vector3<T>, b: &Vector3<T>, c: &Vector3<T>, least_separation_m: T) -> Option<Tilted<T>> {
    let (ab, ac) = (b - a, c - a);
    let across = ab.cross(&ac);
    let length = across.norm_squared().root(); // twice the triangle's area = longest side × least height
    let longest = ab.norm_squared().max(ac.norm_squared()).max((c - b).norm_squared()).root();
    if length < least_separation_m * longest || length <= T::ZERO {
        return None;
    }
    let normal = across / length;
    Some(Tilted { normal: normal.into(), offset_m: -normal.dot(a) })
}
