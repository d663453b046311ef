//! Nearest centroid of each feature.

use umo_core_base::error::{LoadError, StepError, check_finite};
use umo_core_base::memory::with_capacity;
use umo_kernels::activation::argmax;
use umo_kernels::gemm::Epilogue;
use umo_kernels::product::Rows;
use umo_kernels::{Mat, MatMut};

use crate::linear::{Compute, Linear};
use crate::weights::Loader;

/// Centroids as a product: `|x - c|^2` is smallest where `x . c - |c|^2 / 2` is largest.
#[derive(Debug)]
pub(super) struct Kmeans {
    product: Linear,
}

impl Kmeans {
    /// Loads `audio.kmeans.centroids` `[units, width]`.
    pub(super) fn load(loader: &Loader, units: usize, width: usize) -> Result<Self, LoadError> {
        let name = "audio.kmeans.centroids";
        let centroids = loader.values(name, &[units, width])?;
        let mut bias = with_capacity(units);
        bias.extend(centroids.chunks_exact(width).map(half_square));
        Ok(Self { product: loader.linear(&[name.to_owned()], &[units], width)?.with_bias(bias.into()) })
    }

    /// Number of units.
    pub(super) fn units(&self) -> usize {
        self.product.outputs()
    }

    /// Writes the unit of each feature; ties go to the lowest.
    ///
    /// Shapes: `features [rows, width]`, `scores` at least `[rows, units]` (overwritten),
    /// `units [rows]`.
    pub(super) fn nearest(
        &self,
        cx: Compute,
        features: &[f32],
        scores: &mut [f32],
        units: &mut [u32],
    ) -> Result<(), StepError> {
        let x = Mat::new(features, units.len(), self.product.inputs())?;
        let y = MatMut::new(scores, units.len(), self.units())?;
        self.product.apply(cx, Rows::float(x), 0..self.units(), Epilogue::STORE, y)?;
        // A non-finite feature gives non-finite scores, so features need no check.
        check_finite(&scores[..units.len() * self.units()], "audio features")?;
        for (unit, scores) in units.iter_mut().zip(scores.chunks_exact(self.units())) {
            let best = argmax(cx.isa, scores).unwrap_or(0);
            *unit = u32::try_from(best).expect("a config has at most 2^16 units");
        }
        Ok(())
    }
}

/// `-|c|^2 / 2`, summed in f64: it is compared with products that nearly cancel it.
#[expect(clippy::cast_possible_truncation, reason = "rounded to the precision of the product")]
fn half_square(centroid: &[f32]) -> f32 {
    (centroid.iter().map(|&v| f64::from(v) * f64::from(v)).sum::<f64>() / -2.0) as f32
}
