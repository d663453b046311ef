//! The timed part of Intel MKL's interface, from the library that `UMO_MKL` names.

use std::ffi::{CStr, CString, c_void};
use std::mem::transmute_copy;

use umo_core_model::weights::AlignedBox;

type Size = unsafe extern "C" fn(i32, i32, i32, i32) -> usize;
type PackI8 = unsafe extern "C" fn(i32, i32, i32, i32, i32, i32, *const i8, i32, *mut c_void);
#[rustfmt::skip]
type ComputeI8 = unsafe extern "C" fn(
    i32, i32, i32, i32, i32, i32, i32, f32, *const c_void, i32, i8, *const u8, i32, i8, f32, *mut i32, i32, *const i32,
);
type PackF32 = unsafe extern "C" fn(i32, i32, i32, i32, i32, i32, f32, *const f32, i32, *mut f32);
#[rustfmt::skip]
type ComputeF32 = unsafe extern "C" fn(
    i32, i32, i32, i32, i32, i32, *const f32, i32, *const f32, i32, f32, *mut f32, i32,
);

// Values of mkl_cblas.h.
const COL_MAJOR: i32 = 102;
const NO_TRANS: i32 = 111;
const TRANS: i32 = 112;
const PACKED: i32 = 151;
const A_MATRIX: i32 = 161;
const FIX_OFFSET: i32 = 173;

/// The library's functions. Its column-major `A` is our `w`, its `B` our `x`, its `C` our `y`.
pub struct Mkl {
    size_i8: Size,
    pack_i8: PackI8,
    compute_i8: ComputeI8,
    size_f32: Size,
    pack_f32: PackF32,
    compute_f32: ComputeF32,
}

/// A product's dimensions: `y [m, n] = x [m, k] . w [n, k]^T`.
#[derive(Clone, Copy)]
pub struct Shape {
    pub m: usize,
    pub n: usize,
    pub k: usize,
}

impl Shape {
    fn sizes(self) -> [i32; 3] {
        [self.n, self.m, self.k].map(|size| i32::try_from(size).expect("sizes are small"))
    }
}

/// Weights packed by the library for a shape, in several copies.
pub struct Packed<T: umo_core_model::weights::Plain> {
    shape: Shape,
    copies: AlignedBox<T>,
    /// Elements of one copy.
    size: usize,
}

impl Mkl {
    /// Opens the library for this many threads; `None` if `UMO_MKL` is not set.
    pub fn open(threads: usize) -> Option<Self> {
        let path = CString::new(std::env::var("UMO_MKL").ok()?).expect("a path has no zeros");
        // SAFETY: `path` is a C string; opening it runs only Intel's initialisers.
        let library = unsafe { libc::dlopen(path.as_ptr(), libc::RTLD_NOW | libc::RTLD_GLOBAL) };
        assert!(!library.is_null(), "cannot open {path:?}");
        let find = |name: &CStr| {
            // SAFETY: `library` is open, and `name` is a C string.
            let symbol = unsafe { libc::dlsym(library, name.as_ptr()) };
            assert!(!symbol.is_null(), "MKL has no {name:?}");
            symbol
        };
        /// The function behind a symbol.
        macro_rules! function {
            ($type:ty, $name:literal) => {{
                let symbol = find($name);
                // SAFETY: function pointers are as large as pointers; the type is that of
                // mkl_cblas.h with 32-bit integers.
                unsafe { transmute_copy::<*mut c_void, $type>(&symbol) }
            }};
        }
        let set_threads = function!(unsafe extern "C" fn(i32), c"MKL_Set_Num_Threads");
        let threads = i32::try_from(threads).expect("a few threads");
        // SAFETY: any number of threads is allowed.
        unsafe { set_threads(threads) };
        Some(Self {
            size_i8: function!(Size, c"cblas_gemm_s8u8s32_pack_get_size"),
            pack_i8: function!(PackI8, c"cblas_gemm_s8u8s32_pack"),
            compute_i8: function!(ComputeI8, c"cblas_gemm_s8u8s32_compute"),
            size_f32: function!(Size, c"cblas_sgemm_pack_get_size"),
            pack_f32: function!(PackF32, c"cblas_sgemm_pack"),
            compute_f32: function!(ComputeF32, c"cblas_sgemm_compute"),
        })
    }

    /// Packs the weights `[n, k]` in `copies` copies.
    pub fn pack_i8(&self, shape: Shape, w: &[i8], copies: usize) -> Packed<i8> {
        assert_eq!(w.len(), shape.n * shape.k);
        let [n, m, k] = shape.sizes();
        // SAFETY: takes numbers only.
        let size = unsafe { (self.size_i8)(A_MATRIX, n, m, k) }.next_multiple_of(64);
        let mut memory = AlignedBox::<i8>::zeroed(size * copies);
        for copy in memory.chunks_exact_mut(size) {
            let to = copy.as_mut_ptr().cast();
            // SAFETY: `to` has the number of bytes that the library asked for; `w` is `[n, k]` by the
            // assertion.
            unsafe { (self.pack_i8)(COL_MAJOR, A_MATRIX, TRANS, n, m, k, w.as_ptr(), k, to) };
        }
        Packed { shape, copies: memory, size }
    }

    /// `y = x . w^T` with one of the copies.
    pub fn compute_i8(&self, w: &Packed<i8>, copy: usize, x: &[u8], y: &mut [i32]) {
        assert!(x.len() == w.shape.m * w.shape.k && y.len() == w.shape.m * w.shape.n);
        let [n, m, k] = w.shape.sizes();
        let w = w.copies[copy * w.size..][..w.size].as_ptr().cast();
        let (x, y, zero) = (x.as_ptr(), y.as_mut_ptr(), &0);
        // SAFETY: `w` was packed for these sizes; `x` and `y` have them by the assertion.
        unsafe {
            let compute = self.compute_i8;
            compute(COL_MAJOR, PACKED, NO_TRANS, FIX_OFFSET, n, m, k, 1.0, w, k, 0, x, k, 0, 0.0, y, n, zero);
        }
    }

    /// Packs the weights `[n, k]` in `copies` copies.
    pub fn pack_f32(&self, shape: Shape, w: &[f32], copies: usize) -> Packed<f32> {
        assert_eq!(w.len(), shape.n * shape.k);
        let [n, m, k] = shape.sizes();
        // SAFETY: takes numbers only.
        let size = unsafe { (self.size_f32)(A_MATRIX, n, m, k) }.div_ceil(4).next_multiple_of(16);
        let mut memory = AlignedBox::zeroed(size * copies);
        for copy in memory.chunks_exact_mut(size) {
            let to = copy.as_mut_ptr();
            // SAFETY: `to` has the number of bytes that the library asked for; `w` is `[n, k]` by the
            // assertion.
            unsafe { (self.pack_f32)(COL_MAJOR, A_MATRIX, TRANS, n, m, k, 1.0, w.as_ptr(), k, to) };
        }
        Packed { shape, copies: memory, size }
    }

    /// `y = x . w^T` with one of the copies.
    pub fn compute_f32(&self, w: &Packed<f32>, copy: usize, x: &[f32], y: &mut [f32]) {
        assert!(x.len() == w.shape.m * w.shape.k && y.len() == w.shape.m * w.shape.n);
        let [n, m, k] = w.shape.sizes();
        let w = w.copies[copy * w.size..][..w.size].as_ptr();
        let (x, y) = (x.as_ptr(), y.as_mut_ptr());
        // SAFETY: `w` was packed for these sizes; `x` and `y` have them by the assertion.
        unsafe { (self.compute_f32)(COL_MAJOR, PACKED, NO_TRANS, n, m, k, w, k, x, k, 0.0, y, n) };
    }
}
