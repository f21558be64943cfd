//! Every kernel composes, validates and compiles. Host twins and shared constants agree with WGSL. These tests need no device.

use taugate::internals::gpu::BufferCounts;
use taugate::internals::gpu::shader::{self, Binding, Compiled, Source};
use taugate::internals::render::material;
use taugate::internals::wgsl::{SOURCES, layout};

fn kernels() -> Vec<(&'static str, &'static str)> {
    SOURCES.iter().copied().filter(|(path, _)| !path.starts_with("shared/")).collect()
}

fn compile(path: &str, entry: &str, storage: &[String]) -> Result<Compiled, taugate::Error> {
    let file = path.rsplit('/').next().unwrap_or(path);
    shader::compile(&Source::of_file(file, entry, &[])?, storage)
}

/// Devices whose texel buffers are too small for an array use these variants.
#[test]
fn every_kernel_compiles_with_storage_buffers_for_its_texels() {
    let mut arrays = std::collections::BTreeSet::new();
    for (path, text) in kernels() {
        let (module, _) = shader::compose(path, text).and_then(|c| c.parse()).unwrap_or_else(|e| panic!("{e}"));
        for entry in &module.entry_points {
            let usual = compile(path, &entry.name, &[]).unwrap_or_else(|e| panic!("{e}"));
            let texels: Vec<String> = usual.bindings.iter().filter(|b| b.texels).map(|b| b.name.clone()).collect();
            // Each array alone as a storage buffer, then all arrays together.
            let sets = texels.iter().map(|name| vec![name.clone()]).chain([texels.clone()]);
            for storage in sets {
                let variant = compile(path, &entry.name, &storage).unwrap_or_else(|e| panic!("{e}"));
                let expected: Vec<_> = usual
                    .bindings
                    .iter()
                    .map(|b| Binding { texels: b.texels && !storage.contains(&b.name), ..b.clone() })
                    .collect();
                assert_eq!(variant.bindings, expected, "{path}: {}: bindings with {storage:?} in storage", entry.name);
            }
            arrays.extend(texels);
        }
    }
    let tested = |name| arrays.contains(name);
    assert!(tested("bvh_nodes") && tested("shade_points") && tested("marks"), "arrays in texel buffers: {arrays:?}");
}

#[test]
fn every_kernel_compiles() {
    let mut failures = vec![];
    for (path, text) in kernels() {
        match shader::compose(path, text).and_then(|c| c.parse()) {
            Ok((module, _)) => {
                assert!(!module.entry_points.is_empty(), "{path} has no entry point");
                for entry in &module.entry_points {
                    failures.extend(compile(path, &entry.name, &[]).err().map(|e| e.to_string()));
                }
            }
            Err(e) => failures.push(e.to_string()),
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

/// Kernels that trace rays then bind an acceleration structure; no kernel does so otherwise.
#[test]
fn every_kernel_compiles_with_ray_queries() {
    let mut count = 0;
    for (path, text) in kernels() {
        let (module, _) = shader::compose(path, text).and_then(|c| c.parse()).unwrap_or_else(|e| panic!("{e}"));
        let file = path.rsplit('/').next().unwrap_or(path);
        for entry in &module.entry_points {
            let of = |constants: &[(&str, f64)]| {
                let source = Source::of_file(file, &entry.name, constants).unwrap();
                shader::compile(&source, &[]).unwrap_or_else(|e| panic!("{e}"))
            };
            let structures = |compiled: Compiled| compiled.bindings.iter().filter(|b| b.structure).count();
            assert_eq!(structures(of(&[])), 0, "{path}: {}", entry.name);
            count += structures(of(&[(shader::HARDWARE_RAYS, 1.0)]));
        }
    }
    assert!(count >= 5, "only {count} kernels trace rays");
}

/// A device is refused if it cannot bind the buffers of every kernel. With index checks, a kernel binds one more.
#[test]
fn kernels_bind_no_more_buffers_than_a_device_must_allow() {
    let mut most = (0, 0);
    for (path, text) in kernels() {
        let (module, info) = shader::compose(path, text).and_then(|c| c.parse()).unwrap_or_else(|e| panic!("{e}"));
        for index in 0..module.entry_points.len() {
            // All features are present.
            let uses = info.get_entry_point(index);
            let count = |wanted: fn(&naga::AddressSpace) -> bool| {
                let used = module.global_variables.iter().filter(|(handle, _)| !uses[*handle].is_empty());
                used.filter(|(_, variable)| wanted(&variable.space)).count() as u32
            };
            let storage = count(|space| matches!(space, naga::AddressSpace::Storage { .. }));
            let texels = count(|space| *space == naga::AddressSpace::Handle);
            println!("{path} {index}: {storage} storage buffers, {texels} texel buffers");
            most = (most.0.max(storage), most.1.max(texels));
        }
    }
    assert_eq!((most.0 + 1, most.1), (BufferCounts::NEEDED.storage, BufferCounts::NEEDED.texels));
}

/// The host twins of all shared structs.
fn twins() -> Vec<layout::Twin> {
    [layout::twins(), material::twins()].concat()
}

/// All constants that the host shares with the kernels.
fn shared_constants() -> Vec<(&'static str, f64)> {
    [layout::constants::SHARED, material::SHARED].concat()
}

/// The type of the host twin of a field.
fn host_type(module: &naga::Module, ty: naga::Handle<naga::Type>) -> String {
    let scalar = |scalar: naga::Scalar| match scalar.kind {
        naga::ScalarKind::Float => "f32",
        naga::ScalarKind::Uint => "u32",
        naga::ScalarKind::Sint => "i32",
        kind => panic!("the host has no twin of {kind:?}"),
    };
    match module.types[ty].inner {
        naga::TypeInner::Scalar(of) => scalar(of).into(),
        naga::TypeInner::Vector { size, scalar: of } => format!("[{}; {}]", scalar(of), size as u8),
        naga::TypeInner::Array { base, size: naga::ArraySize::Constant(count), .. } => {
            format!("[{}; {count}]", host_type(module, base))
        }
        _ => module.types[ty].name.clone().expect("a struct has a name"),
    }
}

/// Compares the structs of a module with their host twins: names of fields, offsets, types and sizes. Returns the number of
/// structs that have a twin, and a line for each that differs.
fn compare_layouts(module: &naga::Module, twins: &[layout::Twin]) -> (usize, Vec<String>) {
    let mut differences = vec![];
    let mut seen = 0;
    for (_, kind) in module.types.iter() {
        let (Some(name), naga::TypeInner::Struct { members, span }) = (kind.name.as_deref(), &kind.inner) else {
            continue;
        };
        let Some((_, size, fields)) = twins.iter().find(|(n, ..)| *n == name) else { continue };
        seen += 1;
        let of_shader: Vec<(String, usize, String)> = members
            .iter()
            .map(|m| (m.name.clone().unwrap_or_default(), m.offset as usize, host_type(module, m.ty)))
            .collect();
        let of_host: Vec<(String, usize, String)> = fields
            .iter()
            .filter(|(name, ..)| *name != "pad")
            .map(|(name, offset, ty)| (name.to_string(), *offset, ty.to_string()))
            .collect();
        if of_shader != of_host || *size != *span as usize {
            differences.push(format!("{name}: shader {of_shader:?} size {span}, host {of_host:?} size {size}"));
        }
    }
    (seen, differences)
}

#[test]
fn host_twins_have_the_layout_of_the_shaders() {
    let twins = twins();
    let mut seen = 0;
    for (path, text) in kernels() {
        let (module, _) = shader::compose(path, text).and_then(|c| c.parse()).unwrap_or_else(|e| panic!("{e}"));
        let (n, differences) = compare_layouts(&module, &twins);
        assert!(differences.is_empty(), "{path}: {}", differences.join("\n"));
        seen += n;
    }
    assert!(seen > 20, "only {seen} structs compared");
}

#[test]
fn a_wrong_twin_is_noticed() {
    let (path, text) = kernels()[0];
    let (module, _) = shader::compose(path, text).and_then(|c| c.parse()).unwrap_or_else(|e| panic!("{e}"));
    type Field = (&'static str, usize, &'static str);
    let wrong: [fn(&mut Field); 3] = [|field| field.0 = "other", |field| field.1 += 4, |field| field.2 = "[i32; 3]"];
    for change in wrong {
        let mut twins = twins();
        twins.iter_mut().filter_map(|(_, _, fields)| fields.last_mut()).for_each(change);
        assert!(!compare_layouts(&module, &twins).1.is_empty());
    }
}

#[test]
fn shared_constants_agree() {
    let mut found = std::collections::BTreeSet::new();
    let ray_query = SOURCES.iter().copied().filter(|(path, _)| *path == "shared/ray_query");
    for (path, text) in kernels().into_iter().chain(ray_query) {
        let (module, _) = shader::compose(path, text).and_then(|c| c.parse()).unwrap_or_else(|e| panic!("{e}"));
        for (_, constant) in module.constants.iter() {
            let Some(name) = constant.name.as_deref() else { continue };
            let value = match module.global_expressions[constant.init] {
                naga::Expression::Literal(naga::Literal::U32(value)) => f64::from(value),
                naga::Expression::Literal(naga::Literal::F32(value)) => f64::from(value),
                _ => continue,
            };
            if let Some((_, of_host)) = shared_constants().iter().find(|(of_host, _)| *of_host == name) {
                assert_eq!(*of_host, value, "{path}: {name} has another value on the host");
                found.insert(name.to_string());
            }
        }
    }
    let missing: Vec<_> = shared_constants().into_iter().filter(|(name, _)| !found.contains(*name)).collect();
    assert!(missing.is_empty(), "no kernel has the shared constants {missing:?}");
}

/// The host reads or writes every struct that is the element of a bound array or the result of a `load_*` function.
/// Each of these structs has a host twin.
#[test]
fn structs_of_shared_arrays_have_twins() {
    let twins = twins();
    for (path, text) in kernels() {
        let (module, _) = shader::compose(path, text).and_then(|c| c.parse()).unwrap_or_else(|e| panic!("{e}"));
        let element = |ty: naga::Handle<naga::Type>| match module.types[ty].inner {
            naga::TypeInner::Array { base, .. } => base,
            _ => ty,
        };
        let arrays = module.global_variables.iter().filter(|(_, variable)| variable.binding.is_some());
        let unpacked =
            module.functions.iter().filter(|(_, f)| f.name.as_deref().is_some_and(|n| n.starts_with("load_")));
        let types = arrays
            .map(|(_, variable)| element(variable.ty))
            .chain(unpacked.filter_map(|(_, f)| Some(f.result.as_ref()?.ty)));
        for ty in types.map(|ty| &module.types[ty]).filter(|ty| matches!(ty.inner, naga::TypeInner::Struct { .. })) {
            let name = ty.name.as_deref().unwrap_or_default();
            assert!(twins.iter().any(|(twin, ..)| *twin == name), "{path}: {name} has no twin on the host");
        }
    }
}

/// Every device with Vulkan 1.1 can load the kernels: they declare no optional SPIR-V capability. A WGSL builtin could add one.
#[test]
fn kernels_ask_for_nothing_beyond_shaders() {
    const OP_CAPABILITY: u32 = (2 << 16) | 17;
    // Shader, and SampledBuffer for texel buffers. Neither needs a device feature.
    const ALLOWED: [u32; 2] = [1, 46];
    // Images of several gates are on the device only if it has Float64.
    const FLOAT64: u32 = 10;
    let computes_with_f64 = ["add_arrivals", "sum_responses"];
    for (path, text) in kernels() {
        let (module, _) = shader::compose(path, text).and_then(|c| c.parse()).unwrap_or_else(|e| panic!("{e}"));
        for entry in &module.entry_points {
            let words = compile(path, &entry.name, &[]).unwrap_or_else(|e| panic!("{e}")).words;
            let declared: Vec<u32> = words
                .windows(2)
                .skip(5)
                .take_while(|w| w[0] >> 16 != 3)
                .filter(|w| w[0] == OP_CAPABILITY)
                .map(|w| w[1])
                .collect();
            let is_allowed = |c: &u32| ALLOWED.contains(c) || *c == FLOAT64 && computes_with_f64.contains(&path);
            assert!(
                declared.iter().all(is_allowed),
                "{path}: {}: the SPIR-V capabilities are {declared:?}",
                entry.name
            );
        }
    }
}
