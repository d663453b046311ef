//! The C interface, from C: programs in `tests/capi` and `examples/c`, compiled by the machine's C
//! compiler against the header and the built libraries. Tests that need more than that are in
//! `scripts/test/hosts`.
#![cfg(unix)]

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::LazyLock;

use tempfile::TempDir;

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
const MODEL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../models/umo-people/model.safetensors");

/// Paths of the libraries and the program, built with this test's profile, and a folder for
/// compiled programs.
struct Built {
    folder: PathBuf,
    place: TempDir,
}

static BUILT: LazyLock<Built> = LazyLock::new(|| {
    // This test is `FOLDER/deps/capi-…`, whatever `FOLDER` is.
    let own = std::env::current_exe().expect("this test is a file");
    let folder = own.ancestors().nth(2).expect("it lies in a folder of the build").to_owned();
    let mut build = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    build.args(["build", "--quiet", "-p", "umo-capi", "-p", "umo-cli", "--target-dir"]);
    build.arg(folder.parent().expect("a profile's folder lies in the target's")).current_dir(ROOT);
    if folder.ends_with("release") {
        build.arg("--release");
    }
    assert!(build.status().expect("cargo runs").success(), "the libraries do not build");
    let place = tempfile::tempdir().expect("there is room for programs");
    #[cfg(target_os = "linux")]
    std::os::unix::fs::symlink(folder.join("libumo.so"), place.path().join("libumo.so.0")).expect("a link can be made");
    Built { folder, place }
});

/// Which library a program is linked to.
#[derive(Clone, Copy, PartialEq)]
enum Link {
    Shared,
    Static,
    None,
}

/// The machine's C compiler.
fn cc() -> Command {
    strict(Command::new(std::env::var_os("CC").unwrap_or_else(|| "cc".into())))
}

/// The compiler with strict warnings as errors.
fn strict(mut cc: Command) -> Command {
    cc.args(["-Wall", "-Wextra", "-Werror", "-pedantic", "-I"]).arg(format!("{ROOT}/include"));
    cc
}

/// Compiles a program with strict warnings.
fn compile(source: &str, link: Link) -> PathBuf {
    let Built { folder, place } = &*BUILT;
    let kind = if link == Link::Static { "static" } else { "shared" };
    let name = Path::new(source).file_stem().expect("a source has a name").to_string_lossy().into_owned();
    let program = place.path().join(format!("{name}-{kind}"));
    let (mut cc, standard) = match source.ends_with(".cpp") {
        true => (strict(Command::new("c++")), "-std=c++17"),
        false => (cc(), "-std=c11"),
    };
    cc.args([standard, "-O1", "-g", "-D_DEFAULT_SOURCE", "-o"]).arg(&program).arg(format!("{ROOT}/{source}"));
    match link {
        Link::Shared => {
            cc.arg("-L").arg(folder).arg("-lumo").arg(format!("-Wl,-rpath,{}", place.path().display()));
        }
        Link::Static => drop(cc.arg("-DUMO_STATIC").arg(folder.join("libumo.a"))),
        Link::None => {}
    }
    let done = cc.args(["-lpthread", "-ldl", "-lm"]).output().expect("there is a C compiler");
    assert!(done.status.success(), "{source}: {}", String::from_utf8_lossy(&done.stderr));
    program
}

/// Runs a program and asserts that it succeeds.
fn run(program: &Path, arguments: &[&Path]) {
    let done = Command::new(program).args(arguments).output().expect("it was compiled");
    let said = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.success(), "{}: {:?}\n{said}", program.display(), done.status);
}

#[cfg(target_os = "linux")]
#[test]
fn no_limit_of_memory_ends_the_host() {
    run(&compile("tests/capi/memory_limit.c", Link::Static), &[MODEL.as_ref()]);
}

#[test]
#[cfg(all(target_os = "linux", target_env = "gnu"))]
fn a_refused_allocation_is_a_status() {
    let (model, salute) =
        (format!("{ROOT}/tests/golden/mel_k2_arkit/model.safetensors"), format!("{ROOT}/tests/capi/salute.glb"));
    let folder = tempfile::tempdir().expect("there is room");
    let program = compile("tests/capi/refused_memory.c", Link::Shared);
    run(&program, &[model.as_ref(), salute.as_ref(), folder.path()]);
}

#[test]
fn an_exception_of_a_host_s_function_is_an_error() {
    if Command::new("c++").arg("--version").output().is_err() {
        eprintln!("SKIPPED: no C++ compiler; scripts/test/hosts has one");
        return;
    }
    run(&compile("tests/capi/throws.cpp", Link::Shared), &[MODEL.as_ref()]);
}

#[test]
fn the_header_compiles_alone() {
    let check = |mut cc: Command, language: &str, standard: &str| {
        let header = format!("{ROOT}/include/umo.h");
        cc.args([&format!("-std={standard}"), "-Wredundant-decls", "-fsyntax-only", "-x", language, &header]);
        let done = cc.output().expect("there is a compiler");
        assert!(done.status.success(), "{standard}: {}", String::from_utf8_lossy(&done.stderr));
    };
    for standard in ["c99", "c11", "c17"] {
        check(cc(), "c", standard);
    }
    if Command::new("c++").arg("--version").output().is_err() {
        eprintln!("SKIPPED: no C++ compiler; scripts/test/hosts has one");
        return;
    }
    for standard in ["c++11", "c++14", "c++17", "c++20"] {
        let mut cxx = Command::new("c++");
        cxx.args(["-Wall", "-Wextra", "-Werror", "-pedantic"]);
        check(cxx, "c++", standard);
    }
}

/// The C programs of a page.
fn programs(page: &str) -> Vec<String> {
    let text = std::fs::read_to_string(format!("{ROOT}/{page}")).expect("the page is there");
    let blocks = text.split("\n```c\n").skip(1);
    blocks.map(|rest| rest.split_once("```").expect("a block ends").0.to_owned()).collect()
}

#[test]
fn the_c_programs_of_the_documentation_compile_as_c99_and_run() {
    let Built { folder, place } = &*BUILT;
    let mut compilers = vec![std::env::var("CC").unwrap_or_else(|_| "cc".to_owned())];
    let there = |name: &&str| Command::new(name).arg("--version").output().is_ok();
    compilers.extend(["gcc", "clang"].iter().filter(|name| there(name)).map(ToString::to_string));
    let mut pages = vec!["README.md".to_owned()];
    for entry in std::fs::read_dir(format!("{ROOT}/docs")).expect("docs is there") {
        let name = entry.expect("it can be read").file_name().into_string().expect("names are ASCII");
        if name.ends_with(".md") {
            pages.push(format!("docs/{name}"));
        }
    }
    let mut compiled = 0;
    for (page, number, source) in
        pages.iter().flat_map(|page| programs(page).into_iter().enumerate().map(move |(i, text)| (page, i, text)))
    {
        let file = place.path().join(format!("{}-{number}.c", page.replace('/', "-")));
        std::fs::write(&file, &source).expect("there is room");
        for compiler in &compilers {
            let program = file.with_extension("program");
            let mut cc = Command::new(compiler);
            cc.args(["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-I"]).arg(format!("{ROOT}/include"));
            cc.arg(&file).arg("-o").arg(&program).arg("-L").arg(folder).arg("-lumo");
            cc.arg(format!("-Wl,-rpath,{}", place.path().display()));
            let done = cc.output().expect("there is a C compiler");
            assert!(done.status.success(), "{page}, {compiler}: {}", String::from_utf8_lossy(&done.stderr));
            run(&program, &[MODEL.as_ref()]);
        }
        compiled += 1;
    }
    assert!(compiled >= 2 && programs("README.md").len() == 1, "{compiled} programs");
}

/// Names of the functions that the header declares.
fn declared() -> BTreeSet<String> {
    let header = std::fs::read_to_string(format!("{ROOT}/include/umo.h")).expect("it is there");
    let code: String = header.lines().filter(|line| !line.trim_start().starts_with("//")).collect();
    let functions = code.split("UMO_API").skip(1).filter_map(|text| {
        let before = text.split_once('(')?.0;
        Some(before.rsplit([' ', '*']).next()?.to_owned())
    });
    functions.filter(|name| name.starts_with("umo_")).collect()
}

#[test]
#[cfg(target_os = "linux")]
fn the_library_exports_what_the_header_declares_and_nothing_else() {
    let library = BUILT.folder.join("libumo.so");
    let listed = Command::new("nm").args(["-D", "--defined-only"]).arg(&library).output().expect("there is nm");
    let exported: BTreeSet<_> = String::from_utf8(listed.stdout)
        .expect("names are ASCII")
        .lines()
        .filter_map(|line| line.split_whitespace().nth(2).map(str::to_owned))
        .collect();
    let declared = declared();
    assert!(declared.len() > 40);
    assert_eq!(exported, declared);
}

/// Major and minor version numbers.
fn version(text: &str) -> (u32, u32) {
    let mut numbers = text.split('.').map(|part| part.parse().expect("a number"));
    (numbers.next().expect("a major number"), numbers.next().unwrap_or(0))
}

#[test]
#[cfg(all(target_os = "linux", target_env = "gnu"))]
fn the_library_needs_the_glibc_that_is_said() {
    let library = BUILT.folder.join("libumo.so");
    let listed = Command::new("nm").args(["-D", "--undefined-only"]).arg(&library).output().expect("there is nm");
    let listed = String::from_utf8(listed.stdout).expect("names are ASCII");
    let needed = listed.lines().filter_map(|line| Some(version(line.split_once("@GLIBC_")?.1.trim()))).max();
    let needed = needed.expect("it calls the C library");
    let page = std::fs::read_to_string(format!("{ROOT}/packaging/README.md")).expect("it is there");
    let page = page.split_whitespace().collect::<Vec<_>>().join(" ");
    let said = page.split_once("libumo needs glibc ").expect("it says which").1.split_once(" or newer").expect("so");
    let own = Command::new("getconf").arg("GNU_LIBC_VERSION").output().expect("there is getconf");
    let own = String::from_utf8(own.stdout).expect("ASCII");
    // A newer glibc gives functions newer symbol versions; an older one knows only its own.
    if version(own.trim().trim_start_matches("glibc ")) != (2, 36) {
        eprintln!("SKIPPED: what the page says is of a library that was built on glibc 2.36, not {}", own.trim());
        return;
    }
    assert_eq!(needed, version(said.0), "the library needs another glibc than packaging/README.md says");
}

#[test]
fn structures_have_the_layout_that_bindings_know_and_may_grow() {
    run(&compile("tests/capi/layout.c", Link::Shared), &[MODEL.as_ref()]);
}

#[test]
fn wrong_calls_are_errors() {
    let salute = format!("{ROOT}/tests/capi/salute.glb");
    run(&compile("tests/capi/calls.c", Link::Shared), &[MODEL.as_ref(), salute.as_ref()]);
    run(&compile("tests/capi/calls.c", Link::Static), &[MODEL.as_ref(), salute.as_ref()]);
}

#[test]
fn frames_go_where_the_host_wants_them() {
    run(&compile("tests/capi/frames.c", Link::Shared), &[MODEL.as_ref()]);
}

#[test]
fn a_live_mouth_does_not_wait() {
    let model = format!("{ROOT}/tests/golden/mel_k2_arkit/model.safetensors");
    run(&compile("tests/capi/live.c", Link::Shared), &[model.as_ref()]);
}

#[test]
fn no_floating_point_environment_of_the_host_changes_a_bit() {
    let model = format!("{ROOT}/tests/golden/mel_k2_arkit/model.safetensors");
    run(&compile("tests/capi/environment.c", Link::Shared), &[model.as_ref()]);
}

#[test]
fn states_are_saved_and_restored() {
    run(&compile("tests/capi/states.c", Link::Shared), &[MODEL.as_ref()]);
}

#[test]
fn frames_become_files() {
    let folder = tempfile::tempdir().expect("there is room");
    run(&compile("tests/capi/clip.c", Link::Shared), &[MODEL.as_ref(), folder.path()]);
}

#[test]
fn poses_are_put_on_the_host_s_characters() {
    run(&compile("tests/capi/retarget.c", Link::Shared), &[MODEL.as_ref()]);
}

#[test]
fn packets_go_from_a_session_to_decoders() {
    run(&compile("tests/capi/packets.c", Link::Shared), &[MODEL.as_ref()]);
}

#[test]
fn takes_are_recorded_and_played() {
    run(&compile("tests/capi/takes.c", Link::Shared), &[MODEL.as_ref()]);
}

#[test]
fn a_crowd_is_seen_by_viewers() {
    let wav = format!("{ROOT}/assets/hello.wav");
    run(&compile("examples/c/crowd.c", Link::Shared), &[MODEL.as_ref(), wav.as_ref(), "2".as_ref(), "2".as_ref()]);
}

#[test]
#[cfg(all(target_os = "linux", target_env = "gnu"))]
fn nothing_is_allocated_while_a_session_runs() {
    run(&compile("tests/capi/no_alloc.c", Link::Shared), &[MODEL.as_ref()]);
    run(&compile("tests/capi/no_alloc.c", Link::Static), &[MODEL.as_ref()]);
}

#[test]
#[cfg(target_os = "linux")]
fn the_library_can_be_loaded_twice_unloaded_and_forked_under() {
    let (library, copy) = (BUILT.folder.join("libumo.so"), BUILT.place.path().join("copy.so"));
    std::fs::copy(&library, &copy).expect("there is room");
    run(&compile("tests/capi/lifecycle.c", Link::None), &[&library, &copy, MODEL.as_ref()]);
}

/// The numbers of one frame: position, rotations, face.
type Numbers = Vec<u32>;

/// The frames that `umo animate` writes.
fn animated(wav: &str) -> Vec<Numbers> {
    let out = BUILT.place.path().join("animated.jsonl");
    let mut umo = Command::new(BUILT.folder.join("umo"));
    let done = umo.args(["animate", wav, "-o"]).arg(&out).output().expect("it was built");
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let text = std::fs::read_to_string(&out).expect("it was written");
    let frames = text.lines().skip(1).map(|line| {
        let frame: serde_json::Value = serde_json::from_str(line).expect("a line is JSON");
        let mut numbers = Vec::new();
        let mut floats = |list: &serde_json::Value| {
            // The printed form parses back to the same bits.
            let bits = |v: &serde_json::Value| v.to_string().parse::<f32>().expect("a number").to_bits();
            numbers.extend(list.as_array().expect("a list").iter().map(bits));
        };
        floats(&frame["translation"]);
        frame["rotations"].as_array().expect("a list").iter().for_each(&mut floats);
        floats(&frame["face"]);
        numbers
    });
    frames.collect()
}

#[test]
fn the_c_programs_frames_are_those_of_umo_animate() {
    let wav = format!("{ROOT}/assets/hello.wav");
    let out = BUILT.place.path().join("frames.txt");
    run(&compile("examples/c/animate.c", Link::Shared), &[MODEL.as_ref(), wav.as_ref(), &out]);
    let text = std::fs::read_to_string(&out).expect("it was written");
    let frames = text.lines().enumerate().map(|(i, line)| {
        let mut words = line.split(' ');
        assert_eq!(words.next().and_then(|word| word.parse().ok()), Some(i));
        words.map(|word| word.parse::<f32>().expect("a number").to_bits()).collect()
    });
    let (frames, wanted): (Vec<Numbers>, _) = (frames.collect(), animated(&wav));
    assert_eq!(frames.len(), wanted.len());
    assert!(frames.len() > 200 && frames[0].len() == 3 + 4 * 55 + 52);
    let differs = frames.iter().zip(&wanted).position(|(a, b)| a != b);
    assert_eq!(differs, None, "a frame differs");
}

#[test]
fn the_c_program_s_glb_is_that_of_umo_animate() {
    let wav = format!("{ROOT}/assets/hello.wav");
    let [mine, wanted] = ["c.glb", "umo.glb"].map(|name| BUILT.place.path().join(name));
    run(&compile("examples/c/animate.c", Link::Shared), &[MODEL.as_ref(), wav.as_ref(), &mine]);
    let mut umo = Command::new(BUILT.folder.join("umo"));
    let done = umo.args(["animate", &wav, "-o"]).arg(&wanted).output().expect("it was built");
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let [mine, wanted] = [mine, wanted].map(|path| std::fs::read(path).expect("it was written"));
    assert!(mine.len() > 1_000_000 && mine == wanted);
}
