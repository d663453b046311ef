//! `umo figure`: exports a figure as an avatar for other programs.

use umo_gltf::avatar::{self, Kind};

use crate::args::FigureArgs;
use crate::failure::Failure;
use crate::{atomic_file, model};

pub(crate) fn run(args: &FigureArgs) -> Result<(), Failure> {
    let extension = args.output.extension().map(|extension| extension.to_string_lossy().to_lowercase());
    let kind = match extension.as_deref() {
        Some("glb") => Kind::Glb,
        Some("vrm") => Kind::Vrm,
        _ => {
            return Err(Failure::input(format!(
                "`{}`: expected a name that ends with .glb or .vrm",
                args.output.display()
            )));
        }
    };
    let (skeleton, file) = (model::skeleton()?, atomic_file::create(&args.output)?);
    atomic_file::commit(file, |out| avatar::write(args.figure, &skeleton, kind, out))
}
