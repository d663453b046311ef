//! Grouped expert dispatch: a routing of rows to experts in an order that reads each expert's
//! weights once.
//!
//! The products themselves are [`crate::matmul_f32`] and its siblings: an expert's gated product
//! *gathers* its rows from `x` ([`crate::gemm::Input::gather`]) and its down product *scatters*
//! them, weighted, into `y` ([`crate::gemm::Scatter`]). No row is copied, and the weights of an expert without
//! rows are not read.

mod scalar;

use crate::error::{ShapeError, expect_len};
use crate::isa::{Isa, dispatch};
use crate::mat::MatMut;

/// Most experts of one layer.
pub const MAX_EXPERTS: usize = 64;

/// Rows sorted by expert: expert `e` has the slots `starts[e]..starts[e + 1]`; slot `s` is row
/// `rows[s]` with factor `weights[s]`. Within an expert, rows ascend.
#[derive(Debug)]
pub struct Routing<'a> {
    /// `[experts + 1]`.
    pub starts: &'a mut [u32],
    /// `[rows * top_k]`.
    pub rows: &'a mut [u32],
    /// `[rows * top_k]`.
    pub weights: &'a mut [f32],
}

/// Softmax over the router's logits, the `top_k` likeliest experts of each row (ties go to the lower
/// index), their probabilities divided by their sum, and the stable counting sort of all chosen
/// pairs by expert.
///
/// Shapes: `logits [rows, experts]` (overwritten with probabilities), `routing` for `rows * top_k`
/// slots.
/// Numerics: the weight is exactly 1 at `top_k = 1`.
/// Cost: `rows * experts * top_k`; no allocation.
/// Paper: section 3.2; SPEC 2.4.
///
/// # Errors
/// [`ShapeError`] naming the argument whose length disagrees; `top_k` outside `1..=experts`; more
/// than [`MAX_EXPERTS`].
pub fn route(isa: Isa, logits: MatMut<f32>, top_k: usize, routing: &mut Routing) -> Result<(), ShapeError> {
    let (rows, experts) = (logits.rows(), logits.cols());
    if experts > MAX_EXPERTS {
        return Err(ShapeError { arg: "logits", want: MAX_EXPERTS, got: experts });
    }
    if top_k == 0 || top_k > experts {
        return Err(ShapeError { arg: "top_k", want: experts, got: top_k });
    }
    expect_len("routing.starts", experts + 1, routing.starts.len())?;
    expect_len("routing.rows", rows * top_k, routing.rows.len())?;
    expect_len("routing.weights", rows * top_k, routing.weights.len())?;
    // The logits of a few experts fill a quarter of a register: no back-end has a specialised
    // version.
    dispatch!(isa, route(logits, top_k, routing), {
        Scalar: scalar,
        Avx2: scalar,
        AvxVnni: scalar,
        Avx512Vnni: scalar,
        Avx512Bf16: scalar,
        Amx: scalar,
        Neon: scalar,
        NeonDotprod: scalar,
        NeonI8mm: scalar,
        Simd128: scalar,
    });
    Ok(())
}
