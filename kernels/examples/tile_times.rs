//! Times a step of the int8 tile loop, four products of 16 x 16 outputs with 64 inputs: alone, with its four tiles
//! loaded from L1 or L2, and interleaved with 512-bit register operations. Nanoseconds, best of many runs;
//! `docs/kernels.md` quotes them.

#[cfg(not(all(target_arch = "x86_64", target_os = "linux")))]
fn main() {
    println!("no tiles here");
}

#[cfg(all(target_arch = "x86_64", target_os = "linux"))]
fn main() {
    if !umo_kernels::Isa::detect().has_tiles() {
        println!("no tiles here");
        return;
    }
    tiles::measure();
}

#[cfg(all(target_arch = "x86_64", target_os = "linux"))]
mod tiles {
    use std::arch::asm;
    use std::hint::black_box;
    use std::time::Instant;

    /// Bytes of the four tiles of a step, and of the working sets that fit into L1 and L2.
    const STEP: usize = 4096;
    const IN_L1: usize = 8 * STEP;
    const IN_L2: usize = 200 * STEP;
    const ROUNDS: usize = 20_000;

    /// Palette 1: eight tiles of 16 rows of 64 bytes.
    #[repr(align(64))]
    struct Config([u8; 64]);

    #[repr(align(4096))]
    #[derive(Clone)]
    struct Page([u8; STEP]);

    macro_rules! step {
        ($rows:expr, $panels:expr, $x:literal, $registers:expr) => {{
            // SAFETY: the tiles are configured, and 4096 bytes at both places are readable; every
            // register used is named.
            unsafe {
                asm!(
                    concat!($x, " tmm4, [{rows} + {line}]"),
                    "tileloadd tmm6, [{panels} + {line} + 1024]",
                    "tdpbssd tmm0, tmm4, tmm6",
                    concat!($x, " tmm5, [{rows} + {line} + 2048]"),
                    "tdpbssd tmm2, tmm5, tmm6",
                    "tileloadd tmm7, [{panels} + {line} + 3072]",
                    "tdpbssd tmm1, tmm4, tmm7",
                    "tdpbssd tmm3, tmm5, tmm7",
                    rows = in(reg) $rows, panels = in(reg) $panels, line = in(reg) 64_usize, options(nostack, readonly),
                );
            }
            // Zeroing uses no execution port. It replaces values left by the compiler, which might be denormal and slow
            // to multiply. SAFETY: registers only, all of them named.
            unsafe {
                asm!(
                    "vpxord zmm0, zmm0, zmm0", "vpxord zmm1, zmm1, zmm1", "vpxord zmm2, zmm2, zmm2",
                    "vpxord zmm3, zmm3, zmm3", "vpxord zmm4, zmm4, zmm4", "vpxord zmm5, zmm5, zmm5",
                    "vpxord zmm6, zmm6, zmm6", "vpxord zmm7, zmm7, zmm7", "vpxord zmm8, zmm8, zmm8",
                    out("zmm0") _, out("zmm1") _, out("zmm2") _, out("zmm3") _, out("zmm4") _, out("zmm5") _,
                    out("zmm6") _, out("zmm7") _, out("zmm8") _, options(nostack, nomem),
                );
            }
            for _ in (0..64).take($registers / 8) {
                // SAFETY: registers only, all of them named.
                unsafe {
                    asm!(
                        "vfmadd213ps zmm0, zmm8, zmm8", "vfmadd213ps zmm1, zmm8, zmm8", "vfmadd213ps zmm2, zmm8, zmm8",
                        "vfmadd213ps zmm3, zmm8, zmm8", "vfmadd213ps zmm4, zmm8, zmm8", "vfmadd213ps zmm5, zmm8, zmm8",
                        "vfmadd213ps zmm6, zmm8, zmm8", "vfmadd213ps zmm7, zmm8, zmm8",
                        out("zmm0") _, out("zmm1") _, out("zmm2") _, out("zmm3") _, out("zmm4") _, out("zmm5") _,
                        out("zmm6") _, out("zmm7") _, out("zmm8") _, options(nostack, nomem),
                    );
                }
            }
        }};
    }

    pub(super) fn measure() {
        let mut config = Config([0; 64]);
        config.0[0] = 1;
        for tile in 0..8 {
            config.0[16 + 2 * tile] = 64;
            config.0[48 + tile] = 16;
        }
        // SAFETY: tiles were granted, and `config` describes what palette 1 allows.
        unsafe { asm!("ldtilecfg [{}]", in(reg) &raw const config, options(nostack, readonly)) }
        let pages = vec![Page([1; STEP]); IN_L2 / STEP];
        black_box(pages[0].0[0]);
        let at = |i: usize, bytes: usize| pages[i % (bytes / STEP)].0.as_ptr();
        show("four products alone", |_| {
            // SAFETY: the tiles are configured; nothing else is touched.
            unsafe {
                asm!(
                    "tdpbssd tmm0, tmm4, tmm6",
                    "tdpbssd tmm2, tmm5, tmm6",
                    "tdpbssd tmm1, tmm4, tmm7",
                    "tdpbssd tmm3, tmm5, tmm7",
                    options(nostack, nomem)
                );
            }
        });
        let (l1, l2) = (|i: usize| at(i, IN_L1), |i: usize| at(i + IN_L1 / STEP, IN_L2));
        show("with four tiles from L1", |i| step!(l1(i), l1(i), "tileloadd", 0));
        show("with four tiles from L2", |i| step!(l2(i), l2(i), "tileloadd", 0));
        show("with two from L1, two from L2 past L1", |i| step!(l2(i), l1(i), "tileloaddt1", 0));
        show("from L1, beside 32 register operations", |i| step!(l1(i), l1(i), "tileloadd", 32));
        show("from L1, beside 64", |i| step!(l1(i), l1(i), "tileloadd", 64));
        show("from L1, beside 96", |i| step!(l1(i), l1(i), "tileloadd", 96));
        show("from L1, beside 128", |i| step!(l1(i), l1(i), "tileloadd", 128));
        show("from L1, beside 160", |i| step!(l1(i), l1(i), "tileloadd", 160));
        // SAFETY: tiles are configured, and no longer used.
        unsafe { asm!("tilerelease", options(nostack, nomem)) }
    }

    fn show(what: &str, mut step: impl FnMut(usize)) {
        let best = (0..100)
            .map(|_| {
                let start = Instant::now();
                (0..ROUNDS).for_each(&mut step);
                start.elapsed().as_secs_f64()
            })
            .fold(f64::MAX, f64::min);
        println!("{what:<46} {:6.1} ns", 1e9 * best / ROUNDS as f64);
    }
}
