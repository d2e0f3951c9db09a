//! The promises that the project keeps, one file each, in one program: linking a program costs more than most of its
//! tests. Each file opens with what would break; `common` holds what several of them need.
//!
//! Programs of their own are `corpus` and `fuzz`, whose allocator counts the whole process, and `process`, which asks the
//! operating system for its memory.

mod common;

mod architecture;
mod batch;
mod batch_names;
mod bounded_work;
mod budget;
mod build_oracle;
mod build_same_bytes;
mod catalogue_memory;
mod cells;
mod cells_accuracy;
mod changed_files;
mod cleaning;
mod cleaning_volumes;
mod cli_bad_input;
mod compare;
mod csg;
mod damage;
mod dicom;
mod export;
mod export_labels;
mod faults;
mod fixtures;
mod foreign_text;
mod hard_cases;
mod intersect;
mod invariants;
mod label_cells;
mod label_maps;
mod labels;
mod larger_leaves;
mod library;
mod light_leaks;
mod links;
mod manners;
mod many_volumes;
mod memory;
mod mesh_command;
mod mesh_containers;
mod mesh_foreign;
mod mesh_looks;
mod mesh_seldom;
mod mesh_solids;
mod normals;
mod oracle;
mod pack;
mod page;
mod parts;
mod picture_matrix;
mod picture_memory;
mod picture_normals;
mod pores;
mod prelude;
mod privacy;
mod real_files;
mod report;
mod scene_command;
mod scene_pictures;
mod slices_and_strips;
mod slices_kept;
mod solid_ball;
mod solid_cells;
mod spec_example;
mod stated_budgets;
mod stopped;
mod strange_headers;
mod synthetic;
mod thick_slices;
mod traversal;
mod traversal_discrete;
mod traversal_forms;
mod traversal_pictures;
mod uncertainty;
mod visible;
mod volumes;

#[global_allocator]
static ALLOCATOR: common::counting::Counting = common::counting::Counting;
