//! `umo doctor`: self-test on the current machine.

use umo_core_base::defect::keep_quiet;
use umo_self_test::Report;

use crate::args::Doctor;
use crate::failure::Failure;
use crate::model;

pub(crate) fn run(args: &Doctor) -> Result<(), Failure> {
    // A kernel that panics appears in the report.
    keep_quiet(&[umo_core::SOURCES, &[file!()]]);
    let threads = model::threads(&args.compute)?;
    let mut report = umo_self_test::run(&model::load(&args.compute)?, threads);
    if let Some(name) = apple_processor() {
        report.machine.processor = name;
    }
    println!("{report}");
    verdict(&report)
}

fn verdict(report: &Report) -> Result<(), Failure> {
    if report.passed() {
        return Ok(());
    }
    Err(Failure::environment("the self-test failed: please report the text above"))
}

/// Returns Apple's name of the processor; without Apple's libraries only `sysctl` reports it.
fn apple_processor() -> Option<String> {
    if !cfg!(all(target_os = "macos", target_arch = "aarch64")) {
        return None;
    }
    let output =
        std::process::Command::new("/usr/sbin/sysctl").args(["-n", "machdep.cpu.brand_string"]).output().ok()?;
    let name = String::from_utf8(output.stdout).ok()?.trim().to_owned();
    (!name.is_empty()).then_some(name)
}

#[cfg(test)]
mod tests {
    use umo_self_test::kernels::{Checked, Wrong};
    use umo_self_test::machine::Machine;

    use super::*;

    #[test]
    fn a_wrong_kernel_or_a_wrong_motion_ends_the_program_with_1() {
        let sound = Report {
            machine: Machine::this(),
            isa: umo_kernels::Isa::SCALAR,
            kernels: Checked::default(),
            motion: ("model".to_owned(), Ok(umo_self_test::motion::Motion::Repeated(75))),
            speed: None,
        };
        assert_eq!(verdict(&sound), Ok(()));
        let wrong = Wrong { kernel: "matmul_i8", isa: "avx2", detail: "case 3: 1 of 12 results differ".to_owned() };
        let kernels = Checked { wrong: vec![wrong], ..Checked::default() };
        let moved = ("model".to_owned(), Err("frame 14, head: 1 m, recorded 2 m".to_owned()));
        let slow = Some(Err("no frame after 120 s".to_owned()));
        for (report, named) in [
            (Report { kernels, ..sound.clone() }, "matmul_i8 on avx2: case 3"),
            (Report { motion: moved, ..sound.clone() }, "frame 14, head"),
            (Report { speed: slow, ..sound.clone() }, "no frame after"),
        ] {
            let text = report.to_string();
            assert!(text.contains("self-test FAILED") && text.contains(named), "{text}");
            assert_eq!(verdict(&report).map_err(|failure| failure.code()), Err(1));
        }
    }
}
