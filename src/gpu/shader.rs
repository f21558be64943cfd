//! Compiles WGSL to SPIR-V: resolves `#import`, maps errors to source positions, sets override constants, lists bindings.

use std::collections::HashMap;

use naga::back::spv;
use naga::proc::{BoundsCheckPolicies, BoundsCheckPolicy};
use naga::valid::{Capabilities, ValidationFlags, Validator};

use super::{bounds, prune, reachable, spirv, texels};
use crate::error::{Error, Result};
use crate::wgsl::SOURCES;

/// Path and source of the file `name` (without path and ending) in `shaders/` or a folder below it.
fn source(name: &str) -> Option<(&'static str, &'static str)> {
    SOURCES.iter().find(|(path, _)| path.rsplit('/').next() == Some(name)).copied()
}

/// A shader with its imports inserted, and the origin (file and line number) of each line.
pub struct Composed {
    pub text: String,
    origin: Vec<(&'static str, u32)>,
    /// Whether `#import traverse` inserts the module `ray_query`.
    hardware_rays: bool,
}

/// Replaces every `#import` of `text` (file `path`) by the source of the module; each module is inserted once. Fails if a module
/// does not exist or imports itself.
pub fn compose(path: &'static str, text: &str) -> Result<Composed> {
    compose_with(path, text, false)
}

/// As [`compose`]. If `hardware_rays`, the module that traces rays by the BVH is replaced by the one that uses ray queries.
fn compose_with(path: &'static str, text: &str, hardware_rays: bool) -> Result<Composed> {
    let mut composed = Composed { text: String::new(), origin: vec![], hardware_rays };
    include(path, text, &mut vec![], &mut vec![], &mut composed)?;
    // WGSL has this line at its beginning. It must not change the numbers of the others.
    if composed.text.contains(": acceleration_structure;") {
        composed.text.insert_str(0, "enable wgpu_ray_query; ");
    }
    Ok(composed)
}

fn include(
    path: &'static str,
    text: &str,
    done: &mut Vec<&'static str>,
    open: &mut Vec<&'static str>,
    out: &mut Composed,
) -> Result<()> {
    if done.contains(&path) {
        return Ok(());
    }
    if open.contains(&path) {
        return Err(Error::Shader(format!("shaders/{path}.wgsl imports itself through {}", open.join(" -> "))));
    }
    open.push(path);
    for (i, line) in text.lines().enumerate() {
        let at = i as u32 + 1;
        if let Some(name) = line.strip_prefix("#import ") {
            let name = if out.hardware_rays && name.trim() == "traverse" { "ray_query" } else { name };
            let (path_in, text_in) = source(name.trim())
                .ok_or_else(|| Error::Shader(format!("shaders/{path}.wgsl:{at}: no module named {}", name.trim())))?;
            include(path_in, text_in, done, open, out)?;
            continue;
        }
        out.text.push_str(line);
        out.text.push('\n');
        out.origin.push((path, at));
    }
    open.pop();
    done.push(path);
    Ok(())
}

impl Composed {
    fn locate(&self, line: u32, column: u32) -> String {
        match self.origin.get(line as usize - 1) {
            Some((path, at)) => format!("shaders/{path}.wgsl:{at}:{column}"),
            None => String::from("shaders"),
        }
    }

    /// Parses and validates the text. Errors give file, line and column of the original source.
    pub fn parse(&self) -> Result<(naga::Module, naga::valid::ModuleInfo)> {
        let mut options = naga::front::wgsl::Options::new();
        options.capabilities = CAPABILITIES;
        let module = naga::front::wgsl::Frontend::new_with_options(options).parse(&self.text).map_err(|e| {
            let at = e.location(&self.text).map(|l| self.locate(l.line_number, l.line_position)).unwrap_or_default();
            Error::Shader(format!("{at}: {}", e.message()))
        })?;
        let info = Validator::new(ValidationFlags::all(), CAPABILITIES).validate(&module).map_err(|e| {
            let at = e.location(&self.text).map(|l| self.locate(l.line_number, l.line_position)).unwrap_or_default();
            Error::Shader(format!("{at}: {}", e.emit_to_string(&self.text)))
        })?;
        Ok((module, info))
    }
}

const CAPABILITIES: Capabilities = Capabilities::IMMEDIATES.union(Capabilities::RAY_QUERY).union(Capabilities::FLOAT64);

/// Name of the constant that selects the module `ray_query` instead of `traverse`, if its value is 1.
pub const HARDWARE_RAYS: &str = "HARDWARE_RAYS";

/// A buffer that an entry point uses.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Binding {
    pub name: String,
    pub group: u32,
    pub binding: u32,
    /// The kernel reads the buffer as 16-byte texels (`texture_1d<u32>`), not as a storage buffer.
    pub texels: bool,
    /// The kernel traces rays in the acceleration structure that the buffer holds.
    pub structure: bool,
}

/// A compiled entry point, and the buffers and immediates that it needs.
pub struct Compiled {
    /// The SPIR-V module.
    pub words: Vec<u32>,
    /// Every buffer that the entry point uses.
    pub bindings: Vec<Binding>,
    /// Size of the immediates in bytes; 0 if there are none.
    pub constants_size: u32,
    /// Threads per workgroup.
    pub workgroup: u32,
    /// With index checks: source position of every place that is checked; place number 1 comes first. Else empty.
    pub places: Vec<String>,
}

/// Source text, entry point and constants of a kernel.
#[derive(Debug, Clone, PartialEq)]
pub struct Source {
    /// Name of the text in messages.
    path: &'static str,
    text: String,
    pub entry: String,
    /// Values of override constants.
    constants: Vec<(String, f64)>,
}

impl Source {
    /// Entry point `entry` of kernel file `file`. Override constants that the file does not declare are ignored. Fails if there
    /// is no such file.
    pub fn of_file(file: &str, entry: &str, constants: &[(&str, f64)]) -> Result<Source> {
        let (path, text) = source(file).ok_or_else(|| Error::Shader(format!("no kernel file named {file}")))?;
        Ok(Source::new(path, text, entry, constants))
    }

    /// As [`Source::of_file`], for a kernel that is not in `shaders/`. `text` may import modules; `path` is its name in messages.
    pub fn new(path: &'static str, text: &str, entry: &str, constants: &[(&str, f64)]) -> Source {
        let constants = constants.iter().map(|(name, value)| (name.to_string(), *value)).collect();
        Source { path, text: text.into(), entry: entry.into(), constants }
    }

    /// Whether kernels trace rays by ray queries: the constant `HARDWARE_RAYS`, which no text declares, is 1.
    fn hardware_rays(&self) -> bool {
        self.constants.iter().any(|(name, value)| name == HARDWARE_RAYS && *value == 1.0)
    }

    /// Sets the override constant `name` to `value` if it has no value yet.
    pub fn with_default(mut self, name: &str, value: f64) -> Source {
        if self.constants.iter().all(|(other, _)| other != name) {
            self.constants.push((name.into(), value));
        }
        self
    }
}

/// Compiles `source`. The arrays of texels that `storage` names become storage buffers. Fails if the source or an import is
/// wrong, or if there is no such entry point.
pub fn compile(source: &Source, storage: &[String]) -> Result<Compiled> {
    let Source { path, text, entry, constants } = source;
    let mut composed = compose_with(path, text, source.hardware_rays())?;
    composed.text = reachable::keep_reachable(&texels::as_storage(&composed.text, storage), entry);
    let (module, info) = composed.parse()?;
    let wanted: HashMap<String, f64> = constants
        .iter()
        .filter(|(name, _)| module.overrides.iter().any(|(_, o)| o.name.as_deref() == Some(name)))
        .cloned()
        .collect();
    let stage = Some((naga::ShaderStage::Compute, entry.as_str()));
    let (module, _) =
        naga::back::pipeline_constants::process_overrides(&module, &info, stage, &wanted.into_iter().collect())
            .map_err(|e| Error::Shader(format!("shaders/{path}.wgsl: {e}")))?;
    // Remove everything that this entry point does not use, because drivers compile the whole module.
    let mut module = module.into_owned();
    module.entry_points.retain(|e| e.name == *entry);
    if module.entry_points.is_empty() {
        return Err(Error::Shader(format!("shaders/{path}.wgsl has no entry point {entry}")));
    }
    prune::remove_dead_branches(&mut module);
    naga::compact::compact(&mut module, naga::compact::KeepUnused::No);
    let validate = |module: &naga::Module| {
        let info = Validator::new(ValidationFlags::all(), CAPABILITIES).validate(module);
        info.map_err(|e| Error::Shader(format!("shaders/{path}.wgsl: {e}")))
    };
    let mut info = validate(&module)?;
    let mut places = vec![];
    if bounds::checked() {
        let locate = |span: naga::Span| {
            let at = span.location(&composed.text);
            composed.locate(at.line_number, at.line_position)
        };
        places = bounds::instrument(&mut module, &info, locate);
        info = validate(&module)?;
    }
    let uses = info.get_entry_point(0);
    let mut bindings = vec![];
    let mut constants_size = 0;
    for (handle, variable) in module.global_variables.iter() {
        if uses[handle].is_empty() {
            continue;
        }
        let name = variable.name.clone().unwrap_or_default();
        match (&variable.binding, variable.space) {
            (Some(b), space) => {
                let inner = &module.types[variable.ty].inner;
                let structure = matches!(inner, naga::TypeInner::AccelerationStructure { .. });
                let texels = space == naga::AddressSpace::Handle && !structure;
                bindings.push(Binding { name, group: b.group, binding: b.binding, texels, structure });
            }
            (None, naga::AddressSpace::Immediate) => {
                constants_size = module.types[variable.ty].inner.size(module.to_ctx())
            }
            _ => {}
        }
    }
    let pipeline = spv::PipelineOptions { shader_stage: naga::ShaderStage::Compute, entry_point: entry.clone() };
    let words = spv::write_vec(&module, &info, &writer_options(source.hardware_rays()), Some(&pipeline))
        .map_err(|e| Error::Shader(format!("shaders/{path}.wgsl: {e}")))?;
    let workgroup = module.entry_points[0].workgroup_size[0];
    let words = spirv::texel_buffers(&spirv::forbid_contraction(&words));
    Ok(Compiled { words, bindings, constants_size, workgroup, places })
}

/// Every option is given explicitly, because naga's defaults differ between debug and release builds. Vulkan requires SPIR-V 1.4 for ray
/// queries.
fn writer_options(hardware_rays: bool) -> spv::Options<'static> {
    let policy = if bounds::checked() { BoundsCheckPolicy::ReadZeroSkipWrite } else { BoundsCheckPolicy::Unchecked };
    spv::Options {
        lang_version: if hardware_rays { (1, 4) } else { (1, 3) },
        ray_query_initialization_tracking: false,
        flags: spv::WriterFlags::empty(),
        bounds_check_policies: BoundsCheckPolicies {
            index: policy,
            buffer: policy,
            // naga cannot check texel buffers.
            image_load: BoundsCheckPolicy::Unchecked,
            binding_array: policy,
        },
        zero_initialize_workgroup_memory: spv::ZeroInitializeWorkgroupMemoryMode::None,
        force_loop_bounding: false,
        emit_int_div_checks: false,
        use_storage_input_output_16: false,
        ..Default::default()
    }
}
