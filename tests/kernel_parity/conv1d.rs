//! Convolutions as products, against the sum that defines them, in f64.

use proptest::prelude::*;
use umo_kernels::conv1d::{GroupedF32, conv1d_grouped_f32, frames_out, regroup, reorder_weight, windows};
use umo_kernels::gemm::{Epilogue, Input};
use umo_kernels::matmul_f32::matmul_f32;
use umo_kernels::pack::{pack, packed_len};
use umo_kernels::{Isa, Mat, PackedF32};
use umo_tests::{EPSILON, Fill, Guarded, Noise, Placed, cases, for_each_isa};

/// A convolution as PyTorch defines it.
#[derive(Debug)]
struct Conv {
    /// `[frames][channels]`.
    x: Placed<f32>,
    /// `[out, channels / groups, kernel]`.
    weight: Vec<f32>,
    out: usize,
    groups: usize,
    kernel: usize,
    step: usize,
    padding: usize,
}

impl Conv {
    fn new(
        frames: usize,
        channels: usize,
        out: usize,
        groups: usize,
        window: (usize, usize, usize),
        seed: u64,
    ) -> Self {
        let (kernel, step, padding) = window;
        let mut noise = Noise::new(seed);
        let weight = (0..out * (channels / groups) * kernel).map(|_| noise.float(1.0)).collect();
        let x = Placed::new(frames, channels, 0, 0, || Fill::Uniform(1.0).next(&mut noise));
        Self { x, weight, out, groups, kernel, step, padding }
    }

    fn channels(&self) -> usize {
        self.x.mat().cols() / self.groups
    }

    /// Output channel `o` at time `t`, and the sum of the products' sizes.
    fn exact(&self, t: usize, o: usize) -> (f64, f64) {
        let group = o / (self.out / self.groups);
        let (mut sum, mut size) = (0.0, 0.0);
        for k in 0..self.kernel {
            let Some(frame) = (t * self.step + k).checked_sub(self.padding) else { continue };
            if frame >= self.x.mat().rows() {
                continue;
            }
            for c in 0..self.channels() {
                let weight = f64::from(self.weight[(o * self.channels() + c) * self.kernel + k]);
                let product = weight * f64::from(self.x.mat().row(frame)[group * self.channels() + c]);
                sum += product;
                size += product.abs();
            }
        }
        (sum, size)
    }

    /// The weight in the order of windows, packed group by group.
    fn packed(&self) -> Vec<f32> {
        let inputs = self.kernel * self.channels();
        let mut reordered = vec![f32::NAN; self.weight.len()];
        reorder_weight(&self.weight, self.out, self.channels(), self.kernel, &mut reordered).expect("lengths agree");
        let out = self.out / self.groups;
        let mut packed = vec![f32::NAN; self.groups * packed_len(out, inputs)];
        for (g, packed) in packed.chunks_exact_mut(packed_len(out, inputs)).enumerate() {
            let weight = Mat::new(&reordered[g * out * inputs..], out, inputs).expect("sized above");
            pack(weight, packed).expect("sized above");
        }
        packed
    }

    /// Checks the bound of a product with as many terms as a window has.
    fn check(&self, y: &[Vec<f32>]) -> Result<(), TestCaseError> {
        let terms = (self.kernel * self.channels()) as f64;
        for (t, row) in y.iter().enumerate() {
            for (o, &got) in row.iter().enumerate() {
                let (want, size) = self.exact(t, o);
                let tolerance = terms * EPSILON * size + terms * f64::from(f32::MIN_POSITIVE);
                prop_assert!((f64::from(got) - want).abs() <= tolerance, "y[{t}][{o}] = {got}, not {want}");
            }
        }
        Ok(())
    }
}

fn convolution_is_a_product_over_windows(isa: Isa) {
    let kernel = prop::sample::select(vec![2, 3, 10, 128]);
    let step = prop::sample::select(vec![1, 2, 5]);
    let case = (1..6_usize, 1..36_usize, kernel, step, 0..14_usize, any::<u64>());
    proptest!(cases(48), |((channels, out, kernel, step, more, seed) in case)| {
        let conv = Conv::new(kernel - 1 + more, channels, out, 1, (kernel, step, 0), seed);
        let frames = conv.x.mat().rows();
        let data: Vec<f32> = (0..frames).flat_map(|t| conv.x.mat().row(t).to_vec()).collect();
        let windows = windows(&data, frames, channels, kernel, step).expect("lengths agree");
        let packed = conv.packed();
        let w = PackedF32::new(&packed, out, kernel * channels).expect("sized by packed");
        let mut y = Guarded::new(frames_out(frames, kernel, step), out, 0, 0);
        matmul_f32(isa, Input::all(windows), w, Epilogue::STORE, y.mat()).expect("shapes agree");
        conv.check(&y.checked())?;
    });
}

fn grouped_convolution_keeps_groups_apart(isa: Isa) {
    let kernel = prop::sample::select(vec![2, 3, 10, 128]);
    let groups = prop::sample::select(vec![1, 2, 16]);
    let case = (1..20_usize, kernel, groups, 1..4_usize, 1..20_usize, any::<u64>());
    proptest!(cases(48), |((frames, kernel, groups, channels, out, seed) in case)| {
        let padding = kernel / 2;
        let conv = Conv::new(frames, groups * channels, groups * out, groups, (kernel, 1, padding), seed);
        let padded = frames + 2 * padding;
        let mut grouped = vec![f32::NAN; groups * padded * channels];
        regroup(conv.x.mat(), groups, padding, padding, &mut grouped).expect("lengths agree");
        let packed = conv.packed();
        let w = GroupedF32::new(&packed, groups, groups * out, groups * channels, kernel).expect("sized by packed");
        let mut y = Guarded::new(frames_out(padded, kernel, 1), groups * out, 3, 1);
        conv1d_grouped_f32(isa, &grouped, padded, w, Epilogue::STORE, y.mat()).expect("shapes agree");
        conv.check(&y.checked())?;
    });
}

for_each_isa!(
    convolution_is_a_product_over_windows,
    grouped_convolution_keeps_groups_apart
    => every
);

#[test]
fn convolutions_reject_shapes_that_disagree() {
    let arg = |result: Result<Mat<f32>, _>| result.map_err(|error: umo_kernels::ShapeError| error.arg).err();
    assert_eq!(arg(windows(&[0.0; 12], 4, 3, 2, 1)), None);
    assert_eq!(arg(windows(&[0.0; 11], 4, 3, 2, 1)), Some("x"));
    assert_eq!(arg(windows(&[0.0; 12], 4, 3, 0, 1)), Some("kernel"));
    assert_eq!(arg(windows(&[0.0; 12], 4, 3, 2, 0)), Some("step"));
    assert_eq!(windows(&[0.0; 12], 4, 3, 5, 1).expect("no window fits").rows(), 0);
    assert_eq!(GroupedF32::new(&[], 3, 6, 4, 2).expect_err("4 channels in 3 groups").arg, "channels");
    let x = Placed::new(2, 4, 0, 0, || 0.0);
    assert_eq!(regroup(x.mat(), 2, 1, 1, &mut [0.0; 15]).expect_err("one too few").arg, "grouped");
}
