//! What most tests name: helpers of `common`, and the types that everything is made of. Names of a file come first.

pub(crate) use crate::common::assembled::{AssembledVoxel, OptionalSections, assemble};
pub(crate) use crate::common::bodies::Scan;
pub(crate) use crate::common::command::{
    Run, SYSTEM_MIB, binary, measured_build, names, oct, shell, smallest_budget, started, text,
};
pub(crate) use crate::common::containers::{archive, glb};
pub(crate) use crate::common::counting::{Taken, measured};
pub(crate) use crate::common::data::real_data;
pub(crate) use crate::common::dicom::{Elements, Image, Syntax, Writer, firsts, mosaic};
pub(crate) use crate::common::forged::{fault_of, forged, with_section};
pub(crate) use crate::common::formats::{
    Object, Tiff, amira, file, gzip, metaimage, mrc, nifti, npy, nrrd, pngs, vgi, vtk, zlib,
};
pub(crate) use crate::common::frames::{
    Collected, JPEG, MEMORY, RLE, Spec, deflated, encapsulated, frames_of, header_of, image, native, rle,
    rle16, words,
};
pub(crate) use crate::common::memory_tree::MemoryTree;
pub(crate) use crate::common::meshes::Body;
pub(crate) use crate::common::models::{
    build_csg, build_mesh, exact_grid, finest, on_grid, put, share, skin_options,
};
pub(crate) use crate::common::oracle::ExactRay;
pub(crate) use crate::common::random::Random;
pub(crate) use crate::common::scenes::{
    Garbage, Scene, Symmetry, in_ball, in_gyroid, in_torus, noise, plane,
};
pub(crate) use crate::common::system::{ExitStatusExt, FileExt, OsStrExt, latin1, symlink};
pub(crate) use crate::common::tempfile::{self, TempDir};
pub(crate) use crate::common::traverse::{first_hit, first_hit_sealed};
pub(crate) use crate::common::vectors::{cross, dot, unit};
pub(crate) use crate::common::volume::{MemoryVolume, write_raw};
pub(crate) use crate::common::{
    FULL, NORMALS, bodies, caps_and_threads, command, containers, data, dicom, formats, long, meshes,
    metadata, scenes, volume,
};
pub(crate) use infobyte::budget::{Budget, peak_rss_bytes};
pub(crate) use infobyte::builder::{BuildError, ViewedFrom};
pub(crate) use infobyte::clean::SizeLimit;
pub(crate) use infobyte::cpu::Form;
pub(crate) use infobyte::csg::{CsgInput, CsgOptions, NodeId, Operation, Shape, Tree, parse_tree};
pub(crate) use infobyte::discovery::Catalogue;
pub(crate) use infobyte::export::ExportForm;
pub(crate) use infobyte::format::{
    ENTRY_BYTES, Encoding, FormatError, HEADER_BYTES, Header, Metadata, SectionKind, SurfaceKind, normal,
    table_bytes,
};
pub(crate) use infobyte::geom::{BoxIndex, NodeIndex, Octant, Orientation, VoxelIndex, morton};
pub(crate) use infobyte::jobs::export::{ExportRequest, export};
pub(crate) use infobyte::jobs::{info, pack};
pub(crate) use infobyte::load::{Frame, ModelView, NodeView, verify};
pub(crate) use infobyte::mesh::{GridChoice, MeshOptions};
pub(crate) use infobyte::progress::Silent;
pub(crate) use infobyte::render::cells::Cells;
pub(crate) use infobyte::render::pixel_rays::PixelRays;
pub(crate) use infobyte::render::ray::{BadRay, Ray};
pub(crate) use infobyte::render::reference::BitVolume;
pub(crate) use infobyte::render::selfcheck::{Mismatches, random_ray};
pub(crate) use infobyte::render::surface::Skin;
pub(crate) use infobyte::render::tile::{RAYS, TILE, Tile, Tracer};
pub(crate) use infobyte::render::traverse::{Hit, step_limit};
pub(crate) use infobyte::render::{Camera, GridSpace, RenderError, reference, single};
pub(crate) use infobyte::source::dicom::{Access, DicomHeader, FrameSink, ScanError, scan, unroll, visit};
pub(crate) use infobyte::source::{Finding, GapPolicy, RawOptions, RawVolume};
pub(crate) use infobyte::synthetic::analytic;
pub(crate) use infobyte::volume::{Endian, SourceError, Workspace, sentences};
pub(crate) use infobyte::{
    Affine, BuildOptions, BuildReport, Channel, Channels, CleanOptions, Connectivity, Dims, ExitKind,
    MemoryCap, Model, NamedView, OpenOptions, Progress, Projection, RayCaster, RenderRequest, Rescale,
    Samples, ScalarType, Shading, Slices, Smoothing, Threshold, ViewPoint, VolumeSource, Voxels,
};
pub(crate) use serde_json::{Value, json};
pub(crate) use std::collections::{BTreeMap, BTreeSet, HashMap};
pub(crate) use std::fs;
pub(crate) use std::fs::File;
pub(crate) use std::panic::{AssertUnwindSafe, catch_unwind};
pub(crate) use std::path::{Path, PathBuf};
pub(crate) use std::process::{Command, Stdio};
pub(crate) use std::sync::atomic::{AtomicU64, Ordering};
pub(crate) use std::thread::sleep;
pub(crate) use std::time::{Duration, Instant};
