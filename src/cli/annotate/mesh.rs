//! `relief annotate mesh`: the surface of a region.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, bail};
use serde_json::json;

use super::super::output::write_whole;
use super::log_options::{ByArguments, LogArguments};
use super::structure::{NewArguments, find, keep_new, mask_of, report};
use relief_annotation::Geometry;

use relief_annotation::{Decimation, MeshFormat, Smoothing, TriangleMesh, surface_nets};

/// Make a closed mesh of a region, and a file of it
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Smoothing keeps the volume. Files are in patient LPS mm and say so (GLB is in metres, Y up). The mesh becomes an item of the
region's set, unless --only-file is given; of an item that is a mesh already, --out alone writes its file.

Examples:
  relief annotate --db ann.db mesh skull --smooth --out skull.stl
  relief annotate --db ann.db mesh skull --smooth 30 --triangles 50000 --name 'skull, light'
  relief annotate --db ann.db mesh skull --only-file --out skull.glb")]
pub(super) struct MeshArguments {
    /// The region, by id or name
    #[arg(value_name = "ITEM")]
    item: String,
    /// Smooth the surface, N rounds
    #[arg(long, value_name = "ROUNDS", num_args = 0..=1, default_missing_value = "10", value_parser = clap::value_parser!(u32).range(1..=200))]
    smooth: Option<u32>,
    /// Reduce the mesh to about N triangles
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(4..))]
    triangles: Option<u32>,
    /// Write a file: .stl, .ply, .obj or .glb
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Write the file, and make no item
    #[arg(long, requires = "out")]
    only_file: bool,
    /// Name of the mesh [default: the region's name]
    #[arg(long, value_name = "TEXT")]
    name: Option<String>,
    #[command(flatten)]
    by: ByArguments,
    /// Print one JSON object: the item, its measures, and whether the mesh is closed
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &MeshArguments, log: &LogArguments) -> anyhow::Result<ExitCode> {
    let format = arguments.out.as_deref().map(format_of).transpose()?;
    let log = log.open_existing()?;
    let found = find(&log, &arguments.item, "region")?.item;
    let (mut mesh, is_made) = match &found.geometry {
        Some(Geometry::Mesh(summary)) => {
            let (_, bytes) = log.wait(log.store().content(&summary.content))?;
            let mesh = relief_exchange::mesh_of_content(&bytes)
                .with_context(|| format!("cannot use {:?}", found.name))?;
            (mesh, arguments.smooth.is_some() || arguments.triangles.is_some())
        }
        _ => (surface_nets(&mask_of(&log, &found)?)?, true),
    };
    if let Some(rounds) = arguments.smooth {
        mesh = mesh.smoothed(Smoothing { rounds })?;
    }
    if let Some(triangles) = arguments.triangles {
        mesh = mesh.decimated(Decimation::to(triangles as usize))?;
    }
    let name = arguments.name.clone().unwrap_or_else(|| found.name.clone());
    if let (Some(path), Some(format)) = (&arguments.out, format) {
        write_whole(path, &relief_annotation::write_mesh(format, &mesh, &name)?)?;
    }
    let mut item = found.clone();
    if is_made && !arguments.only_file {
        let by = ByArguments { who: arguments.by.who.clone(), reason: arguments.by.reason.clone() };
        let new = NewArguments { name, set: found.set.clone(), by };
        let kept = relief_exchange::content_of_mesh(&mesh)?;
        item = keep_new(&log, &new, found.frame_of_reference.clone(), kept, Geometry::Mesh)?;
    } else if arguments.out.is_none() {
        bail!("item {:?} is a mesh already; give --out FILE, --smooth or --triangles", found.name);
    }
    report(&item, &mesh_report(&mesh), arguments.json)?;
    Ok(ExitCode::SUCCESS)
}

fn format_of(path: &std::path::Path) -> anyhow::Result<MeshFormat> {
    let names = MeshFormat::ALL.map(|format| format!(".{}", format.name())).join(", ");
    MeshFormat::of(path)
        .with_context(|| format!("cannot tell the format of {}; end it in one of {names}", path.display()))
}

fn mesh_report(mesh: &TriangleMesh) -> serde_json::Value {
    let measures = mesh.measures();
    json!({
        "vertices": mesh.vertices.len(),
        "triangles": mesh.triangles.len(),
        "area_mm2": measures.area_mm2,
        "volume_ml": measures.volume_ml,
        "closed": measures.is_closed,
        "manifold": measures.is_manifold,
    })
}
