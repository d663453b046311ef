//! Calibration for quantization: the Gram matrix of each product's inputs, which tells how an error of its weights
//! changes its outputs. `umo model quantize` rounds weights by it.

use std::ops::Range;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use umo_kernels::gemm::{Epilogue, Input};
use umo_kernels::matmul_f32::matmul_f32;
use umo_kernels::pack::{pack, packed_len};
use umo_kernels::{Isa, Mat, MatMut, PackedF32};

use umo_core_base::error::StepError;
use umo_core_base::memory::filled;

/// Rows per matrix product.
const ROWS: usize = 128;
/// Unit of thinning: after `r` rows one row in `r / ALL`, rounded up to a power of two, is used; below `2 * ALL`
/// rows, all.
const ALL: usize = 8192;

/// Gram matrices of a model's products. A model loaded with a calibration adds the input rows of every product that
/// it computes, on any number of threads.
#[derive(Debug, Default)]
pub struct Calibration {
    /// Names of the tensors to record; all others cost nothing.
    wanted: Vec<String>,
    products: Mutex<Vec<Arc<Gram>>>,
}

impl Calibration {
    /// Records the tensors `wanted`, named as in the model file.
    pub fn new(wanted: Vec<String>) -> Self {
        Self { wanted, products: Mutex::default() }
    }

    /// Records of the tensor `name`: one matrix per range of its rows.
    pub fn of(&self, name: &str) -> Vec<(Range<usize>, Arc<Gram>)> {
        let named = |gram: &Arc<Gram>| {
            let mine = gram.tensors.iter().filter(|(tensor, _)| tensor == name);
            mine.map(|(_, rows)| (rows.clone(), Arc::clone(gram))).collect::<Vec<_>>()
        };
        locked(&self.products).iter().flat_map(named).collect()
    }

    /// Creates the record of a product with rows of some tensors, if any of them is wanted.
    pub(crate) fn product(&self, tensors: Vec<(String, Range<usize>)>, inputs: usize, isa: Isa) -> Option<Arc<Gram>> {
        if !tensors.iter().any(|(name, _)| self.wanted.contains(name)) {
            return None;
        }
        let gram = Arc::new(Gram { tensors, inputs, isa, state: Mutex::default() });
        locked(&self.products).push(Arc::clone(&gram));
        Some(gram)
    }
}

/// Sum of `x x^T` over the rows `x` that a product has read.
#[derive(Debug)]
pub struct Gram {
    /// Tensors, and ranges of their rows, that make up the product's weights.
    tensors: Vec<(String, Range<usize>)>,
    inputs: usize,
    isa: Isa,
    state: Mutex<State>,
}

#[derive(Debug, Default)]
struct State {
    rows: usize,
    /// `[inputs, ROWS]`; the first `filled` columns are in use.
    pending: Vec<f32>,
    filled: usize,
    /// `[inputs, inputs]`
    sum: Vec<f64>,
}

impl Gram {
    /// Number of rows that the product has read.
    pub fn rows(&self) -> usize {
        locked(&self.state).rows
    }

    /// The sum over all rows so far, `[inputs, inputs]`.
    ///
    /// # Errors
    /// [`StepError`] if a length disagrees: a defect of this library.
    pub fn sum(&self) -> Result<Vec<f64>, StepError> {
        let mut state = locked(&self.state);
        self.multiply(&mut state)?;
        let none = state.sum.is_empty();
        Ok(if none { filled(0.0, self.inputs * self.inputs) } else { state.sum.clone() })
    }

    /// Adds the rows of `x`.
    pub fn add(&self, x: Input<f32>) -> Result<(), StepError> {
        let mut state = locked(&self.state);
        for t in 0..x.rows() {
            // One row in `each`, chosen by hash because rows come in patterns, and weighted to represent all of them.
            let each = (state.rows / ALL).next_power_of_two();
            state.rows += 1;
            if !drawn(state.rows, each) {
                continue;
            }
            #[expect(clippy::cast_precision_loss, reason = "a small number")]
            let weight = (each as f32).sqrt();
            if state.pending.is_empty() {
                state.pending = filled(0.0, self.inputs * ROWS);
            }
            let at = state.filled;
            for (to, &v) in state.pending[at..].iter_mut().step_by(ROWS).zip(x.row(t)) {
                *to = weight * v;
            }
            state.filled += 1;
            if state.filled == ROWS {
                self.multiply(&mut state)?;
            }
        }
        Ok(())
    }

    /// Adds the products of the pending rows.
    fn multiply(&self, state: &mut State) -> Result<(), StepError> {
        if state.filled == 0 {
            return Ok(());
        }
        let k = self.inputs;
        for column in state.pending.chunks_exact_mut(ROWS) {
            column[state.filled..].fill(0.0);
        }
        let x = Mat::new(&state.pending, k, ROWS)?;
        let (mut packed, mut y) = (filled(0.0, packed_len(k, ROWS)), filled(0.0, k * k));
        pack(x, &mut packed)?;
        let w = PackedF32::new(&packed, k, ROWS)?;
        matmul_f32(self.isa, Input::all(x), w, Epilogue::STORE, MatMut::new(&mut y, k, k)?)?;
        state.filled = 0;
        if state.sum.is_empty() {
            state.sum = filled(0.0, k * k);
        }
        state.sum.iter_mut().zip(y).for_each(|(sum, v)| *sum += f64::from(v));
        Ok(())
    }
}

/// Whether row `row` is the one in `each` (a power of two) to use: by a multiplicative hash.
fn drawn(row: usize, each: usize) -> bool {
    (row as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 32 & (each as u64 - 1) == 0
}

/// Locks a mutex; poisoning is ignored, since nothing panics while holding it.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Beyond a number of rows, a sample represents all.
    #[test]
    fn of_many_rows_some_count_for_all() {
        let gram =
            Calibration::new(vec!["a".to_owned()]).product(vec![("a".to_owned(), 0..1)], 1, Isa::SCALAR).unwrap();
        // Every fourth row differs.
        let values: Vec<f32> = (0..8 * ALL).map(|i| if i % 4 == 1 { 2.0 } else { 1.0 }).collect();
        gram.add(Input::all(Mat::new(&values, 8 * ALL, 1).unwrap())).unwrap();
        let wanted = values.iter().map(|v| f64::from(v * v)).sum::<f64>();
        let sum = gram.sum().unwrap()[0];
        assert!((sum / wanted - 1.0).abs() < 0.03, "{sum} {wanted}");
        assert_eq!(gram.rows(), 8 * ALL);
    }

    /// Indexed rows and all rows, more than one matrix product takes, against sums in f64.
    #[test]
    fn sums_are_those_of_all_rows() {
        let (rows, inputs) = (ROWS + 37, 19);
        let values: Vec<f32> = (0..rows * inputs).map(|i| ((i * 31 % 101) as f32 - 50.0) / 16.0).collect();
        let index = [3_u32, 3, 0, 36];
        let calibration = Calibration::new(vec!["b".to_owned()]);
        assert!(calibration.product(vec![("c".to_owned(), 0..4)], inputs, Isa::SCALAR).is_none());
        let tensors = vec![("a".to_owned(), 0..4), ("b".to_owned(), 0..2)];
        let gram = calibration.product(tensors, inputs, Isa::detect()).unwrap();
        let x = Mat::new(&values, rows, inputs).unwrap();
        gram.add(Input::all(x)).unwrap();
        gram.add(Input::gather(x, &index).unwrap()).unwrap();

        let all = (0..rows).chain(index.map(|t| t as usize));
        let mut wanted = vec![0.0; inputs * inputs];
        for t in all {
            for (at, sum) in wanted.iter_mut().enumerate() {
                *sum += f64::from(x.row(t)[at / inputs]) * f64::from(x.row(t)[at % inputs]);
            }
        }
        assert_eq!(gram.rows(), rows + index.len());
        let found = calibration.of("b");
        assert_eq!((found.len(), found[0].0.clone()), (1, 0..2));
        for (got, wanted) in found[0].1.sum().unwrap().iter().zip(&wanted) {
            assert!((got - wanted).abs() < 1e-4 * wanted.abs().max(1.0), "{got} {wanted}");
        }
    }
}
