use super::*;
use std::fs;
use tempfile::TempDir;

fn folder() -> TempDir {
    tempfile::tempdir().unwrap()
}

fn names(folder: &TempDir) -> Vec<String> {
    let entries = fs::read_dir(folder.path()).unwrap();
    let name = |entry: io::Result<fs::DirEntry>| entry.unwrap().file_name();
    let mut names: Vec<String> = entries.map(|e| name(e).into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn write_leaves_one_whole_file_per_format() {
    let folder = folder();
    let clip = sample::clip(FaceKind::Arkit, 3, 1);
    for format in Format::ALL {
        let path = folder.path().join(format!("out.{}", format.name()));
        write(&path, None, &clip).unwrap();
        let size = usize::try_from(fs::metadata(path).unwrap().len()).unwrap();
        assert_eq!(size, written(format, &clip, usize::MAX).unwrap());
    }
    let want = ["out.bvh", "out.csv", "out.glb", "out.jsonl", "out.npz", "out.vrma"];
    assert_eq!(names(&folder), want);
}

#[test]
fn write_takes_the_given_format_over_the_extension() {
    let folder = folder();
    let path = folder.path().join("out.txt");
    let clip = sample::clip(FaceKind::Arkit, 1, 1);
    write(&path, Some(Format::Bvh), &clip).unwrap();
    assert!(fs::read_to_string(path).unwrap().starts_with("HIERARCHY"));
}

#[test]
fn a_failed_write_leaves_the_earlier_file() {
    let folder = folder();
    let path = folder.path().join("out.npz");
    fs::write(&path, "earlier").unwrap();
    let mut clip = sample::clip(FaceKind::SmplxExpression, 1, 1);
    clip.face_values[0] = f32::NAN;
    assert!(matches!(write(&path, None, &clip), Err(ExportError::Clip(_))));
    let csv = folder.path().join("out.csv");
    assert!(matches!(write(&csv, None, &clip), Err(ExportError::Face(_))));
    assert_eq!(fs::read_to_string(path).unwrap(), "earlier");
    assert_eq!(names(&folder), ["out.npz"]);
}

#[test]
fn a_panic_leaves_nothing_behind() {
    let folder = folder();
    let path = folder.path().join("out.glb");
    let result = std::panic::catch_unwind(|| {
        let _output = Output::create(&path, Format::Glb).unwrap();
        assert_eq!(names(&folder).len(), 1);
        panic!("in the middle of the work");
    });
    assert!(result.is_err());
    assert!(names(&folder).is_empty());
}

#[test]
fn two_outputs_of_one_name_do_not_meet() {
    let folder = folder();
    let path = folder.path().join("out.bvh");
    let clip = sample::clip(FaceKind::Arkit, 1, 1);
    let first = Output::create(&path, Format::Bvh).unwrap();
    let second = Output::create(&path, Format::Jsonl).unwrap();
    first.write(&clip, Figure::default()).unwrap();
    second.write(&clip, Figure::default()).unwrap();
    assert!(fs::read_to_string(&path).unwrap().starts_with('{'));
    assert_eq!(names(&folder), ["out.bvh"]);
}

#[test]
fn an_unwritable_output_is_named() {
    let folder = folder();
    let clip = sample::clip(FaceKind::Arkit, 1, 1);
    let message = |path: &Path| {
        let message = write(path, Some(Format::Bvh), &clip).unwrap_err().to_string();
        assert!(message.contains(&format!("`{}`", path.display())), "{message}");
        message
    };
    message(&folder.path().join("no/such/folder/out.bvh"));
    assert!(message(folder.path()).ends_with("it is a directory"));
    let file = folder.path().join("file");
    fs::write(&file, "").unwrap();
    message(&file.join("out.bvh"));
    let locked = folder.path().join("locked.bvh");
    fs::write(&locked, "").unwrap();
    let mut permissions = fs::metadata(&locked).unwrap().permissions();
    permissions.set_readonly(true);
    fs::set_permissions(&locked, permissions).unwrap();
    assert!(message(&locked).ends_with("it is read-only"));
    assert_eq!(names(&folder), ["file", "locked.bvh"]);
}

#[cfg(unix)]
#[test]
fn a_link_is_followed_and_a_device_is_left_alone() {
    let folder = folder();
    let clip = sample::clip(FaceKind::Arkit, 1, 1);
    let (file, link) = (folder.path().join("file.bvh"), folder.path().join("link.bvh"));
    fs::write(&file, "").unwrap();
    std::os::unix::fs::symlink(&file, &link).unwrap();
    write(&link, None, &clip).unwrap();
    assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
    assert!(fs::read_to_string(&file).unwrap().starts_with("HIERARCHY"));
    let device = write(Path::new("/dev/null"), Some(Format::Bvh), &clip);
    let message = device.unwrap_err().to_string();
    assert_eq!(message, "cannot write `/dev/null`: it is not a regular file");
}
