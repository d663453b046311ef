//! The peak of int8 with int8 matrix products.

use super::neon::SUMS;
use crate::isa::{NeonI8mm, entry};
use core::arch::asm;

entry! {
    /// `smmla`, in assembly, as the intrinsic is not stable.
    pub(super) fn int8(_token: NeonI8mm, rounds: usize) -> Option<usize> {
        if rounds == 0 {
            return Some(0);
        }
        // SAFETY: this function enables the instruction, and only named registers are touched;
        // `rounds` is at least 1.
        unsafe {
            asm!(
                "2:",
                "smmla v0.4s, v24.16b, v25.16b", "smmla v1.4s, v24.16b, v25.16b", "smmla v2.4s, v24.16b, v25.16b",
                "smmla v3.4s, v24.16b, v25.16b", "smmla v4.4s, v24.16b, v25.16b", "smmla v5.4s, v24.16b, v25.16b",
                "smmla v6.4s, v24.16b, v25.16b", "smmla v7.4s, v24.16b, v25.16b", "smmla v8.4s, v24.16b, v25.16b",
                "smmla v9.4s, v24.16b, v25.16b", "smmla v10.4s, v24.16b, v25.16b", "smmla v11.4s, v24.16b, v25.16b",
                "smmla v12.4s, v24.16b, v25.16b", "smmla v13.4s, v24.16b, v25.16b", "smmla v14.4s, v24.16b, v25.16b",
                "smmla v15.4s, v24.16b, v25.16b", "smmla v16.4s, v24.16b, v25.16b", "smmla v17.4s, v24.16b, v25.16b",
                "smmla v18.4s, v24.16b, v25.16b", "smmla v19.4s, v24.16b, v25.16b", "smmla v20.4s, v24.16b, v25.16b",
                "smmla v21.4s, v24.16b, v25.16b", "smmla v22.4s, v24.16b, v25.16b", "smmla v23.4s, v24.16b, v25.16b",
                "subs {rounds}, {rounds}, #1",
                "b.ne 2b",
                rounds = inout(reg) rounds => _,
                out("v0") _, out("v1") _, out("v2") _, out("v3") _, out("v4") _, out("v5") _, out("v6") _, out("v7") _,
                out("v8") _, out("v9") _, out("v10") _, out("v11") _, out("v12") _, out("v13") _, out("v14") _, out("v15") _,
                out("v16") _, out("v17") _, out("v18") _, out("v19") _, out("v20") _, out("v21") _, out("v22") _, out("v23") _,
                options(nostack, nomem),
            );
        }
        Some(rounds * SUMS * 32)
    }
}
