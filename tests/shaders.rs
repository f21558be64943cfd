//! Level 0: every kernel composes, validates and compiles; host twins and constants agree with WGSL. Needs no device.

use taugate::internals::gpu::shader::{self, Binding, Compiled, Source};
use taugate::internals::wgsl::{SOURCES, layout};

fn kernels() -> Vec<(&'static str, &'static str)> {
    SOURCES.iter().copied().filter(|(path, _)| !path.starts_with("shared/")).collect()
}

fn compile(path: &str, entry: &str, storage: &[String]) -> Result<Compiled, taugate::Error> {
    let file = path.rsplit('/').next().unwrap_or(path);
    shader::compile(&Source::of_file(file, entry, &[])?, storage)
}

/// For devices whose texel buffers are too small for an array.
#[test]
fn every_kernel_compiles_with_storage_buffers_for_its_texels() {
    let mut arrays = std::collections::BTreeSet::new();
    for (path, text) in kernels() {
        let (module, _) = shader::compose(path, text).and_then(|c| c.parse()).unwrap_or_else(|e| panic!("{e}"));
        for entry in &module.entry_points {
            let usual = compile(path, &entry.name, &[]).unwrap_or_else(|e| panic!("{e}"));
            let texels: Vec<String> = usual.bindings.iter().filter(|b| b.texels).map(|b| b.name.clone()).collect();
            // Each alone, and all of them.
            let sets = texels.iter().map(|name| vec![name.clone()]).chain([texels.clone()]);
            for storage in sets {
                let variant = compile(path, &entry.name, &storage).unwrap_or_else(|e| panic!("{e}"));
                let expected: Vec<_> = usual
                    .bindings
                    .iter()
                    .map(|b| Binding { texels: b.texels && !storage.contains(&b.name), ..b.clone() })
                    .collect();
                assert_eq!(variant.bindings, expected, "{path}: {}", entry.name);
            }
            arrays.extend(texels);
        }
    }
    assert!(arrays.contains("bvh_nodes") && arrays.contains("shade_points") && arrays.contains("marks"), "{arrays:?}");
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

/// Compares every host twin that a module mentions with its reflection; returns the differences.
fn compare_layouts(module: &naga::Module, twins: &[layout::Twin]) -> (usize, Vec<String>) {
    let mut differences = vec![];
    let mut seen = 0;
    for (_, kind) in module.types.iter() {
        let (Some(name), naga::TypeInner::Struct { members, span }) = (kind.name.as_deref(), &kind.inner) else {
            continue;
        };
        let Some((_, size, fields)) = twins.iter().find(|(n, ..)| *n == name) else { continue };
        seen += 1;
        let of_shader: Vec<(String, usize)> =
            members.iter().map(|m| (m.name.clone().unwrap_or_default(), m.offset as usize)).collect();
        let of_host: Vec<(String, usize)> =
            fields.iter().filter(|(n, _)| *n != "pad").map(|(n, o)| (n.to_string(), *o)).collect();
        if of_shader != of_host || *size != *span as usize {
            differences.push(format!("{name}: shader {of_shader:?} size {span}, host {of_host:?} size {size}"));
        }
    }
    (seen, differences)
}

#[test]
fn host_twins_have_the_layout_of_the_shaders() {
    let twins = layout::twins();
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
    let mut twins = layout::twins();
    for (_, _, fields) in &mut twins {
        if let Some(last) = fields.last_mut() {
            last.1 += 4;
        }
    }
    let (path, text) = kernels()[0];
    let (module, _) = shader::compose(path, text).and_then(|c| c.parse()).unwrap_or_else(|e| panic!("{e}"));
    assert!(!compare_layouts(&module, &twins).1.is_empty());
}

#[test]
fn shared_constants_agree() {
    let mut found = std::collections::BTreeSet::new();
    for (path, text) in kernels() {
        let (module, _) = shader::compose(path, text).and_then(|c| c.parse()).unwrap_or_else(|e| panic!("{e}"));
        for (_, constant) in module.constants.iter() {
            let Some(name) = constant.name.as_deref() else { continue };
            let naga::Expression::Literal(naga::Literal::U32(value)) = module.global_expressions[constant.init] else {
                continue;
            };
            for (host_name, host_value) in layout::constants::ALL {
                if *host_name == name {
                    assert_eq!(*host_value, value, "{name} in {path}");
                    found.insert(name.to_string());
                }
            }
        }
    }
    let missing: Vec<_> = layout::constants::ALL.iter().filter(|(n, _)| !found.contains(*n)).collect();
    assert!(missing.is_empty(), "not in any kernel: {missing:?}");
}

/// Every device with Vulkan 1.1 must be able to load the kernels: no optional capability slips in through a builtin.
#[test]
fn kernels_ask_for_nothing_beyond_shaders() {
    const OP_CAPABILITY: u32 = (2 << 16) | 17;
    // Shader, and SampledBuffer for texel buffers: both without a device feature behind them.
    const ALLOWED: [u32; 2] = [1, 46];
    for (path, text) in kernels() {
        let (module, _) = shader::compose(path, text).and_then(|c| c.parse()).unwrap_or_else(|e| panic!("{e}"));
        for entry in &module.entry_points {
            let words = compile(path, &entry.name, &[]).unwrap_or_else(|e| panic!("{e}")).words;
            let asked: Vec<u32> = words
                .windows(2)
                .skip(5)
                .take_while(|w| w[0] >> 16 != 3)
                .filter(|w| w[0] == OP_CAPABILITY)
                .map(|w| w[1])
                .collect();
            assert!(asked.iter().all(|c| ALLOWED.contains(c)), "{path}: {}: {asked:?}", entry.name);
        }
    }
}
