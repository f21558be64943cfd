//! Host twins of the structs in `shaders/`: same names, same order of fields. WGSL is the source of truth: a test reflects every
//! kernel and compares names, offsets, types and sizes, and fails if a twin differs. The twin of `Material` is in `render/material.rs`,
//! beside the code that fills it in.

pub const NONE: u32 = u32::MAX;

/// Layout of a struct, for the layout test: name, size in bytes, and name, offset in bytes and type of every field.
pub type Twin = (&'static str, usize, Vec<(&'static str, usize, &'static str)>);

/// Declares host twins, and the function `twins()`, which returns the layout of each for the test.
macro_rules! host_twins {
    ($($(#[$doc:meta])* $name:ident { $($field:ident: $type:ty),* $(,)? })*) => {
        $(
            $(#[$doc])*
            #[repr(C)]
            #[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
            pub struct $name { $(pub $field: $type),* }
        )*

        /// Layouts of the twins of this file, for the layout test.
        pub fn twins() -> Vec<$crate::wgsl::layout::Twin> {
            vec![$((
                stringify!($name),
                size_of::<$name>(),
                vec![$((stringify!($field), std::mem::offset_of!($name, $field), stringify!($type))),*],
            )),*]
        }
    };
}
pub(crate) use host_twins;

/// Declares constants with the same values as in WGSL, and `SHARED`, which lists them for the test.
macro_rules! shared_constants {
    ($($(#[$doc:meta])* $name:ident: $type:ty = $value:expr),* $(,)?) => {
        $($(#[$doc])* pub const $name: $type = $value;)*

        /// Names and values of the constants of this file. An f64 represents every u32 and f32 exactly.
        pub const SHARED: &[(&str, f64)] = &[$((stringify!($name), $name as f64)),*];
    };
}
pub(crate) use shared_constants;

host_twins! {
    /// `shared/frame.wgsl`
    Frame {
        right: [f32; 3], width: u32,
        up: [f32; 3], height: u32,
        forward: [f32; 3], seed: u32,
        extent: [f32; 2], pixel_area: f32, splat_sample_count: f32,
        gate_lo: f32, gate_hi: f32, cull_hi: f32, rounding_allowance: f32,
        emitter_lo: [f32; 3], iteration: u32,
        emitter_hi: [f32; 3], light_paths: u32,
        max_depth: u32, queries: u32, deterministic_count: u32, emitter_count: u32,
        tree3_root: u32, tree4_root: u32, keep_s0: f32, keep_t1: f32,
        keep_s2: f32, crop_x: u32, crop_y: u32, crop_width: u32,
        crop_height: u32, first_sample: u32, emitter_vertex_count: u32, slots: u32,
        sensor: [f32; 3], query_sample_count: f32,
        splat_share: f32, media_count: u32, principal_offset: [f32; 2],
        gap_lo: f32, gap_hi: f32, min_detour: f32, auxiliary_density: f32,
        vertex_count: u32, sensor_solid: u32, undelayed_lo: f32, merge_radius: f32,
        photon_list_mask: u32, lowest_photon_level: i32, highest_photon_level: i32, merge_slot: f32,
        lens_radial: [f32; 4], lens_rest: [f32; 4], lens_limit: f32, lens_radius: f32, inverse_focus: f32, blades: u32,
        vignetting: [[f32; 4]; 16],
    }
    /// `shared/frame.wgsl`
    Dispatch { first: u32, count: u32, bounce: u32, counter: u32, list_a: u32, list_b: u32, rank: u32, emitter: u32 }
    /// `shared/scene.wgsl`
    Triangle { v0: [f32; 3], instance: u32, v1: [f32; 3], corner: u32, v2: [f32; 3], material: u32 }
    /// `shared/scene.wgsl`
    VertexAttributes { normal: u32, u: f32, v: f32 }
    /// `shared/scene.wgsl`
    VertexDetails { red_green: u32, blue_alpha: u32, tangent: u32 }
    /// `shared/scene.wgsl`
    InstanceNormals { x: [f32; 3], pad0: f32, y: [f32; 3], pad1: f32, z: [f32; 3], pad2: f32 }
    /// `shared/scene.wgsl`
    TextureInfo { first: u32, width: u32, height: u32, sampler: u32 }
    /// `shared/scene.wgsl`
    Emitter {
        kind: u32, triangle: u32, keep: f32, other: u32,
        position: [f32; 3], select_pdf: f32,
        direction: [f32; 3], outer: f32,
        strength: [f32; 3], inner: f32,
        solid: u32, pad0: u32, pad1: u32, pad2: u32,
    }
    /// `shared/medium.wgsl`
    Medium {
        lo: [f32; 3], phase: u32,
        hi: [f32; 3], share: f32,
        sigma_s: [f32; 3], g: f32,
        sigma_a: [f32; 3], g2: f32,
        alpha: f32, mean_cosine: f32, table: u32, table_size: u32,
    }
    /// `shared/grid.wgsl`
    Grid {
        x: [f32; 4], y: [f32; 4], z: [f32; 4],
        cells: [u32; 3], first: u32,
        first_block: u32, scale: f32, mean: f32, is_linear: u32,
    }
    /// `shared/path.wgsl`
    PathState {
        position: [f32; 3], tau: f32,
        direction: [f32; 3], eta: f32,
        throughput: [f32; 3], flags: u32,
        shift: [f32; 3], select_pdf: f32,
        d_vcm: f32, d_vc: f32, emitter: u32, triangle: u32,
    }
    /// `shared/path.wgsl`
    PathVertex {
        position: [f32; 3], tau: f32,
        throughput: [f32; 3], material: u32,
        normal: [f32; 3], d_vcm: f32,
        geometric: [f32; 3], d_vc: f32,
        to_previous: [f32; 3], flags: u32,
        point_words: [u32; 3], eta: f32,
        offset: f32, select_pdf: f32, owner: u32, selection_cdf: u32,
    }
    /// `shared/path.wgsl`
    FogSegment { throughput: [f32; 3], limit: f32, d_vcm: f32, d_vc: f32, length: f32, solid: u32 }
    /// `shared/sky.wgsl`
    SkyHeader { width: u32, height: u32, select_pdf: f32, disk_pdf: f32 }
    /// `shared/tree.wgsl`
    TreeChild { lo: [f32; 3], tau_lo: f32, hi: [f32; 3], tau_hi: f32, buckets_low: u32, buckets_high: u32, power_unit: f32, child: u32 }
    /// `shared/tree.wgsl`
    TreeNode { left: TreeChild, right: TreeChild }
    /// `shared/leaf.wgsl`
    LeafRecord { position: [f32; 3], tau: f32, power: f32, direction: u32, flags: u32, material: u32 }
    /// `shared/photon.wgsl`
    Photon { position: [f32; 3], tau: f32, direction: [f32; 3], eta: f32, power: [f32; 3], flags: u32, normal: [f32; 3], level: i32 }
    /// `shared/candidate.wgsl`
    Candidate { vertex: u32, weight: f32 }
    /// `shared/observed.wgsl`
    SensorContribution { red: f32, green: f32, blue: f32, detail: f32, path: u32, vertex: u32 }
    /// `shared/ellipsoid_search.wgsl`
    TriangleChoice { triangle: u32, count: u32 }
    /// `shared/ellipsoidal_connection.wgsl`
    AuxiliaryPoint { triangle: u32, tau: f32, weights: [f32; 2] }
}

/// Constants that the host shares with the kernels; the layout test compares their values.
pub mod constants {
    super::shared_constants! {
        STACK_SIZE: u32 = 32,
        TRIANGLE_SMOOTH: u32 = 0x8000_0000,
        TRIANGLE_ALPHA: u32 = 0x4000_0000,
        TRIANGLE_MIRRORED: u32 = 0x2000_0000,
        TRIANGLE_DETAILED: u32 = 0x1000_0000,
        TRIANGLE_NULL: u32 = 0x0800_0000,
        TRIANGLE_SHEET: u32 = 0x0400_0000,
        TANGENT_MIRRORED: u32 = 0x1_0000,
        TEXTURE_TRANSFORM_SHIFT: u32 = 5,
        TRIANGLE_MATERIAL: u32 = 0x00ff_ffff,
        RAY_GROUP_OPAQUE: u32 = 1,
        RAY_GROUP_PASSABLE: u32 = 2,
        RAY_GROUP_BOUNDARY: u32 = 4,
        EMITTER_TRIANGLE: u32 = 0,
        EMITTER_POINT: u32 = 1,
        EMITTER_SPOT: u32 = 2,
        EMITTER_BEAM: u32 = 3,
        EMITTER_SUN: u32 = 4,
        EMITTER_SKY: u32 = 5,
        SKY_VERTEX: u32 = 0xffff_fffe,
        NOT_TRACED: f32 = -3e38,
        ALBEDO_COLUMNS: u32 = 64,
        ALBEDO_ROWS: u32 = 32,
        /// Distance between a triangle and the origin of a ray that leaves it, relative to the largest coordinate of the
        /// triangle.
        OFFSET_SCALE: f32 = 1.0 / (1 << 19) as f32,
        PATH_ALIVE: u32 = 1,
        PATH_SMOOTH: u32 = 64,
        PATH_SOLID_SHIFT: u32 = 20,
        VERTEX_DEPTH: u32 = 0xff,
        VERTEX_EMITTER: u32 = 0x100,
        VERTEX_DETERMINISTIC: u32 = 0x200,
        VERTEX_FRONT: u32 = 0x400,
        VERTEX_VALID: u32 = 0x800,
        VERTEX_TRANSMITS: u32 = 0x4000,
        VERTEX_BUMPED: u32 = 0x8000,
        VERTEX_IN_MEDIUM: u32 = 0x1_0000,
        VERTEX_SOLID_SHIFT: u32 = 20,
        OUTSIDE_SOLIDS: u32 = 0,
        CLEAR_SOLID: u32 = 1,
        FIRST_INTERIOR: u32 = 2,
        BLOCK: u32 = 8,
        PHASE_LOBES: u32 = 0,
        PHASE_RAYLEIGH: u32 = 1,
        PHASE_DRAINE: u32 = 2,
        PHASE_TABLE: u32 = 3,
        EMIT_ONE_SIDED: u32 = 0,
        EMIT_TWO_SIDED: u32 = 1,
        EMIT_POINT: u32 = 2,
        EMIT_SPOT: u32 = 3,
        EMIT_SUN: u32 = 4,
        LEAF_BIT: u32 = 0x8000_0000,
        LEAF_FIRST: u32 = 0x07ff_ffff,
        BUCKETS: u32 = 8,
        CHUNK: u32 = 32,
        LISTS: u32 = 4,
        COUNTER_TOTALS: u32 = 8,
        COUNTER_TALLIES: u32 = 12,
        LIVING_LIST: u32 = 0,
        SHADE_LIST: u32 = 2,
        CANDIDATE_LIST: u32 = 3,
        TIME_SLOTS: u32 = 4,
        MEDIUM_FACTOR: f32 = 4.0,
        PATH_BITS: u32 = 24,
        ESTIMATOR_PT: u32 = 0,
        ESTIMATOR_BDPT: u32 = 1,
        ESTIMATOR_LCS_PAPER: u32 = 2,
        ESTIMATOR_LCS_BY_TIME: u32 = 3,
        ESTIMATOR_EPC: u32 = 4,
        ELLIPSOIDAL: u32 = 0x4000_0000,
        PART_LEAVES: u32 = 0x8000_0000,
        MEAN_ARC: f32 = 25.0,
        DETERMINISTIC_SLOTS: u32 = 8,
        SLOTS_PER_MARK: u32 = 32,
        TALLIED_PATHS: u32 = 32,
        MAX_SUBTREES: u32 = 32,
        MAX_TIME_GROUPS: u32 = 16,
        OBSERVE_TIMES: u32 = 1,
        OBSERVE_STRATEGIES: u32 = 2,
        OBSERVE_RESPONSES: u32 = 3,
    }
}
