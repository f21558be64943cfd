//! Runs functions of `shaders/` on the device, in a small kernel that is made from a template. Each thread handles one input.
//!
//! A [`ShaderFunction`] fills the template: the modules to import, the fields of an input and of a result, and the lines that
//! compute `result` from `input`. WGSL determines the layout of the fields; the host's records must have the same size.

use bytemuck::{AnyBitPattern, NoUninit};
use taugate::internals::gpu::{Buffer, Device, Kernel, Recorder, shader};
use taugate::internals::wgsl::layout::Dispatch;

use crate::device::device;

/// The parts that the template leaves open.
#[derive(Clone, Copy)]
pub struct ShaderFunction {
    pub imports: &'static [&'static str],
    /// Fields of `Input`, e.g. `w: vec3<f32>, alpha: f32`.
    pub input: &'static str,
    /// Fields of `Result`.
    pub result: &'static str,
    /// WGSL statements that read `input` and assign `result`.
    pub body: &'static str,
}

impl ShaderFunction {
    pub fn text(&self) -> String {
        let imports: String = self.imports.iter().map(|name| format!("#import {name}\n")).collect();
        let ShaderFunction { input, result, body, .. } = self;
        format!(
            "#import frame\n{imports}
struct Input {{ {input} }}
struct Result {{ {result} }}
@group(2) @binding(8) var<storage, read> inputs: array<Input>;
@group(2) @binding(9) var<storage, read_write> outputs: array<Result>;
@compute @workgroup_size(WORKGROUP)
fn test_main(@builtin(global_invocation_id) id: vec3<u32>) {{
    if (id.x >= dispatch.count) {{
        return;
    }}
    let input = inputs[id.x];
    var result: Result;
    {body}
    outputs[id.x] = result;
}}
"
        )
    }

    /// Sizes of `Input` and `Result` on the device, in bytes.
    fn sizes(&self) -> [usize; 2] {
        let (module, _) = self.parse();
        ["Input", "Result"].map(|wanted| {
            let named = module.types.iter().find(|(_, t)| t.name.as_deref() == Some(wanted));
            named.expect("the template declares it").1.inner.size(module.to_ctx()) as usize
        })
    }

    fn parse(&self) -> (naga::Module, naga::valid::ModuleInfo) {
        shader::compose("test", &self.text()).and_then(|c| c.parse()).unwrap_or_else(|e| panic!("{e}\n{}", self.text()))
    }

    /// Names of the functions that the body calls directly.
    #[allow(dead_code, reason = "not every test lists functions")]
    pub fn called(&self) -> Vec<String> {
        let (module, _) = self.parse();
        let mut names = vec![];
        calls(&module, &module.entry_points[0].function.body, &mut names);
        names
    }

    /// Compiles the kernel for the device of this test. Fails the test if there is no device.
    pub fn compile(&self, constants: &[(&str, f64)]) -> CompiledFunction {
        let device = device();
        let kernel = Kernel::from_source(&device, "test", &self.text(), "test_main", constants);
        CompiledFunction {
            kernel: kernel.unwrap_or_else(|e| panic!("{e}\n{}", self.text())),
            device,
            sizes: self.sizes(),
        }
    }

    /// Compiles the kernel, runs it and returns one result per input. `buffers` are bound by their WGSL names.
    #[allow(dead_code, reason = "some tests compile once and run often")]
    pub fn run<I: NoUninit, O: AnyBitPattern + NoUninit>(&self, inputs: &[I], buffers: &[Contents]) -> Vec<O> {
        self.compile(&[]).run(inputs, buffers)
    }
}

/// The contents of a buffer, and the name of the buffer in WGSL.
pub struct Contents {
    name: &'static str,
    bytes: Vec<u8>,
}

/// Contents of the buffer that WGSL calls `name`.
pub fn contents<T: NoUninit>(name: &'static str, data: &[T]) -> Contents {
    Contents { name, bytes: bytemuck::cast_slice(data).to_vec() }
}

#[allow(dead_code, reason = "for tests that run whole kernels")]
impl Contents {
    pub fn name(&self) -> &'static str {
        self.name
    }

    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }
}

/// A compiled test kernel.
pub struct CompiledFunction {
    device: Device,
    kernel: Kernel,
    sizes: [usize; 2],
}

impl CompiledFunction {
    pub fn run<I: NoUninit, O: AnyBitPattern + NoUninit>(&self, inputs: &[I], buffers: &[Contents]) -> Vec<O> {
        assert_eq!(self.sizes, [size_of::<I>(), size_of::<O>()], "bytes of Input and Result, device and host");
        let upload = |bytes: &[u8]| Buffer::from_slice(&self.device, "test", bytes, "").expect("upload");
        let owned: Vec<(&str, Buffer)> = buffers.iter().map(|c| (c.name, upload(&c.bytes))).collect();
        let input = upload(bytemuck::cast_slice(inputs));
        let outputs = Buffer::new::<O>(&self.device, "results", inputs.len(), "").expect("a buffer for the results");
        let mut all: Vec<(&str, &Buffer)> = owned.iter().map(|(name, buffer)| (*name, buffer)).collect();
        all.extend([("inputs", &input), ("outputs", &outputs)]);
        let bindings = self.kernel.bind(&all).expect("binding");
        let dispatch = Dispatch { count: inputs.len() as u32, ..bytemuck::Zeroable::zeroed() };
        let mut recorder = Recorder::new(&self.device).expect("recorder");
        let groups = self.kernel.groups(inputs.len());
        recorder.dispatch("test", &self.kernel, &bindings, &dispatch, groups).expect("dispatch");
        recorder.submit().expect("submit");
        outputs.to_vec(inputs.len()).expect("reading the results")
    }
}

/// Adds the names of the functions that a block calls.
pub fn calls(module: &naga::Module, block: &naga::Block, names: &mut Vec<String>) {
    use naga::Statement;
    for statement in block.iter() {
        match statement {
            Statement::Call { function, .. } => names.extend(module.functions[*function].name.clone()),
            Statement::Block(inner) => calls(module, inner, names),
            Statement::If { accept, reject, .. } => {
                [accept, reject].map(|b| calls(module, b, names)).into_iter().collect()
            }
            Statement::Loop { body, continuing, .. } => {
                [body, continuing].map(|b| calls(module, b, names)).into_iter().collect()
            }
            Statement::Switch { cases, .. } => cases.iter().for_each(|c| calls(module, &c.body, names)),
            _ => {}
        }
    }
}
