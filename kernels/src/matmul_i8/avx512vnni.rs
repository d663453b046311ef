//! Four inputs of 16 outputs per instruction: `vpdpbusd`, which multiplies unsigned by signed
//! bytes.
//!
//! Inputs are offset to unsigned (`x + 128`), either beforehand in a buffer on the stack, a
//! tile of rows at a time, or when they are loaded. The epilogue subtracts the excess,
//! `128 * sum(w)`, from the sums. All arithmetic wraps in 32 bits, so that the sums are exact.

pub(crate) mod end;
mod one_stream;
mod tiles;

use super::chunk::{CHUNK_BYTES, FEW_ROWS};
use super::input::{GemmTask, QuantInput};
use crate::gemm::Epilogue;
use crate::isa::{Avx512Vnni, entry};
use crate::mat::MatMut;
use crate::pack::{PANEL, PackedI8, QUAD};
use crate::tiling::Tiling;
use crate::tuning::Tuning;
use umo_kernels_features::avx512vnni;

entry! {
    pub(super) fn matmul(_token: Avx512Vnni, x: QuantInput, w: PackedI8, epilogue: Epilogue, y: MatMut<f32>, tuning: Tuning) {
        run(x, &GemmTask::Plain(w, epilogue), y, tuning);
    }

    pub(super) fn matmul_gated(
        _token: Avx512Vnni,
        x: QuantInput,
        gate: PackedI8,
        up: PackedI8,
        y: MatMut<f32>,
        tuning: Tuning,
    ) {
        run(x, &GemmTask::Gated(gate, up), y, tuning);
    }
}

/// Sizes at which the loops change, with either profile.
pub(super) fn tiling(_token: Avx512Vnni) -> Tiling {
    Tiling {
        rows: &[one_stream::UNFETCHED, FEW_ROWS, tiles::EVEN_ROWS, one_stream::ROWS, tiles::ROWS],
        outputs: &[PANEL, tiles::MAX_PANELS * PANEL, 2 * tiles::MAX_PANELS * PANEL],
        inputs: &[QUAD, one_stream::UNROLL * QUAD, tiles::BYTES, one_stream::SHORT * QUAD, tiles::QUADS * QUAD],
        held: 0,
        chunk: CHUNK_BYTES,
    }
}

#[avx512vnni]
fn run(x: QuantInput, task: &GemmTask, y: MatMut<f32>, tuning: Tuning) {
    if one_stream::suits(&x, task, tuning) {
        one_stream::run(&x, task, y, tuning);
    } else if tuning.offset_on_load {
        tiles::run_in_place(x, task, y);
    } else {
        tiles::run(x, task, y);
    }
}
