//! Tables of the documentation, for tests that compare them with the code.

use std::path::{Path, PathBuf};

use umo_kernels::Isa;

/// A table of a page: its location, and its rows of cells, the header first.
#[derive(Clone, Debug)]
pub struct Table {
    /// The page and the line of the header.
    pub place: String,
    /// Header and rows, without the separator line.
    pub rows: Vec<Vec<String>>,
}

/// Root of the repository.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Collects the files with one of these extensions under a folder, recursively, without build outputs.
pub fn files(folder: &Path, extensions: &[&str], found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("the documentation can be read") {
        let path = entry.expect("the documentation can be read").path();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if path.is_dir() && !name.starts_with('.') && !["target", "node_modules"].contains(&&*name) {
            files(&path, extensions, found);
        } else if path.extension().is_some_and(|extension| extensions.iter().any(|&other| extension == other)) {
            found.push(path);
        }
    }
}

/// Every table of the documentation whose header `wanted` accepts.
pub fn tables(wanted: impl Fn(&[String]) -> bool) -> Vec<Table> {
    let (root, mut paths) = (root(), vec![]);
    for folder in ["docs", "bindings", "packaging", "models", "training", "cli", "umo-core", "umo-capi"] {
        files(&root.join(folder), &["md"], &mut paths);
    }
    paths.push(root.join("README.md"));
    let mut tables: Vec<Table> = vec![];
    for path in paths {
        let text = std::fs::read_to_string(&path).expect("the documentation can be read");
        // The table of the preceding lines, if it is wanted.
        let mut table: Option<Table> = None;
        let mut inside = false;
        for (line, row) in text.lines().enumerate() {
            let row = row.trim().strip_prefix('|').and_then(|row| row.strip_suffix('|'));
            let cells: Option<Vec<_>> = row.map(|row| row.split('|').map(|cell| cell.trim().to_owned()).collect());
            match cells {
                None => {
                    tables.extend(table.take());
                    inside = false;
                }
                Some(cells) if inside => {
                    if let Some(table) = &mut table {
                        table.rows.push(cells);
                    }
                }
                Some(cells) => {
                    inside = true;
                    let place = format!("{}:{}", path.display(), line + 1);
                    table = wanted(&cells).then(|| Table { place, rows: vec![cells] });
                }
            }
        }
        tables.extend(table);
    }
    for table in &mut tables {
        assert!(table.rows.len() > 2, "{}: a table without rows", table.place);
        // The separator line below the header.
        table.rows.remove(1);
    }
    tables
}

/// Rows of the one table with the header `first` and "the same bits on": first cells, and
/// groups of back-ends.
pub fn same_bits(first: &str) -> Vec<(String, Vec<Vec<Isa>>)> {
    let mut found = tables(|header| header == [first, "the same bits on"]);
    assert_eq!(found.len(), 1, "one table of \"{first}\"");
    let Table { place, rows } = found.remove(0);
    rows[1..].iter().map(|row| (row[0].clone(), groups(&row[1], &place))).collect()
}

/// Back-ends of other targets.
const OTHERS: &[&str] = if cfg!(target_arch = "aarch64") {
    &["avx2", "avxvnni", "avx512vnni", "avx512bf16", "amx", "simd128"]
} else if cfg!(all(target_arch = "x86_64", target_os = "linux")) {
    &["neon", "neon_dotprod", "neon_i8mm", "simd128"]
} else if cfg!(target_arch = "x86_64") {
    &["amx", "neon", "neon_dotprod", "neon_i8mm", "simd128"]
} else if cfg!(target_arch = "wasm32") {
    &["avx2", "avxvnni", "avx512vnni", "avx512bf16", "amx", "neon", "neon_dotprod", "neon_i8mm"]
} else {
    &["avx2", "avxvnni", "avx512vnni", "avx512bf16", "amx", "neon", "neon_dotprod", "neon_i8mm", "simd128"]
};

/// Back-ends in a cell, "scalar; avx2, avxvnni; …" or "all", if this processor has
/// them. Every back-end is in one group.
fn groups(cell: &str, place: &str) -> Vec<Vec<Isa>> {
    let every: Vec<_> = Isa::names().collect();
    let groups: Vec<Vec<&str>> = match cell {
        "all" => vec![every.clone()],
        _ => cell.split("; ").map(|group| group.split(", ").collect()).collect(),
    };
    let mut named = groups.concat();
    named.sort_unstable();
    let mut all: Vec<_> = if cell == "all" { every } else { [&every, OTHERS].concat() };
    all.sort_unstable();
    assert_eq!(named, all, "{place}: \"{cell}\" does not name every back-end once");
    groups.iter().map(|group| group.iter().filter_map(|name| Isa::from_name(name)).collect()).collect()
}
