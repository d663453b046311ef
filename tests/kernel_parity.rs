//! Tests every kernel against its contract, on every back-end that this processor has. Shapes are
//! drawn around the tile sizes that the back-ends themselves list (`umo_kernels::tiling`).

#[path = "kernel_parity/activation.rs"]
mod activation;
#[path = "kernel_parity/attention.rs"]
mod attention;
#[path = "kernel_parity/bf16.rs"]
mod bf16;
#[path = "kernel_parity/bf16_rows.rs"]
mod bf16_rows;
#[path = "kernel_parity/conv1d.rs"]
mod conv1d;
#[path = "kernel_parity/experts.rs"]
mod experts;
#[path = "kernel_parity/filter.rs"]
mod filter;
#[path = "kernel_parity/norm.rs"]
mod norm;
#[path = "kernel_parity/products.rs"]
mod products;
#[path = "kernel_parity/quantize.rs"]
mod quantize;
#[path = "kernel_parity/same_bits.rs"]
mod same_bits;

use umo_kernels::Isa;

#[test]
fn required_back_ends_exist() {
    for name in umo_tests::required() {
        assert!(Isa::from_name(&name).is_some(), "UMO_TEST_REQUIRE names {name}, which this processor does not have");
    }
}

#[test]
fn scalar_is_always_there() {
    assert_eq!(Isa::available().next(), Some(Isa::SCALAR));
    assert_eq!(Isa::from_name("scalar"), Some(Isa::SCALAR));
}
