//! Devices: the lifetimes of buffers and kernels, and use from several threads.

use taugate::internals::gpu::{Bindings, Buffer, Device, Kernel, Recorder};
use taugate::internals::render::Renderer;

/// Adds 1 to every word of `words`.
const COUNT: &str = "
@group(0) @binding(0) var<storage, read_write> words: array<u32>;
@compute @workgroup_size(64) fn count(@builtin(global_invocation_id) id: vec3u) {
    if id.x < arrayLength(&words) { words[id.x] += 1u; }
}";
const WORDS: usize = 1 << 10;

fn open() -> Device {
    Device::open(None).unwrap_or_else(|e| panic!("these tests need a Vulkan device: {e}"))
}

fn kernel(device: &Device) -> Kernel {
    Kernel::from_source(device, "count", COUNT, "count", &[]).unwrap()
}

fn zeros(device: &Device) -> Buffer {
    Buffer::from_slice(device, "words", &[0u32; WORDS], "").unwrap()
}

fn dispatch(recorder: &mut Recorder, kernel: &Kernel, bindings: &Bindings) {
    recorder.dispatch("count", kernel, bindings, &0u32, kernel.groups(WORDS)).unwrap();
}

#[test]
fn all_may_go_to_another_thread_and_a_device_be_shared() {
    fn moves<T: Send>() {}
    fn shares<T: Sync>() {}
    moves::<Device>();
    moves::<Buffer>();
    moves::<Kernel>();
    moves::<Bindings>();
    moves::<Recorder>();
    moves::<Renderer>();
    shares::<Device>();
    shares::<Buffer>();
    shares::<Kernel>();
    shares::<Bindings>();
}

#[test]
fn bindings_keep_their_buffers_alive() {
    let device = open();
    let kernel = kernel(&device);
    // Kernels with index checks own a buffer, so the count does not start at 0.
    let before = device.bytes_in_use();
    let words = zeros(&device);
    let bindings = kernel.bind(&[("words", &words)]).unwrap();
    drop(words);
    assert_eq!(device.bytes_in_use() - before, WORDS as u64 * 4);
    let mut recorder = Recorder::new(&device).unwrap();
    dispatch(&mut recorder, &kernel, &bindings);
    drop(bindings);
    assert_eq!(device.bytes_in_use() - before, WORDS as u64 * 4, "the recorded work still needs the buffer");
    recorder.submit().unwrap();
    assert_eq!(device.bytes_in_use(), before);
}

#[test]
fn what_is_recorded_outlives_kernel_and_bindings() {
    let device = open();
    let words = zeros(&device);
    let mut recorder = Recorder::new(&device).unwrap();
    {
        let kernel = kernel(&device);
        let bindings = kernel.bind(&[("words", &words)]).unwrap();
        dispatch(&mut recorder, &kernel, &bindings);
    }
    recorder.submit().unwrap();
    assert_eq!(words.to_vec::<u32>(WORDS).unwrap(), [1; WORDS]);
}

#[test]
fn threads_share_a_queue() {
    let device = open();
    let kernel = kernel(&device);
    let rounds = 50;
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| {
                let mut words = zeros(&device);
                let bindings = kernel.bind(&[("words", &words)]).unwrap();
                let mut recorder = Recorder::new(&device).unwrap();
                for round in 0..rounds {
                    words.write(0, &[0u32; WORDS / 2]).unwrap();
                    dispatch(&mut recorder, &kernel, &bindings);
                    recorder.submit().unwrap();
                    let seen = words.to_vec::<u32>(WORDS).unwrap();
                    assert!(seen[..WORDS / 2].iter().all(|&word| word == 1));
                    assert!(seen[WORDS / 2..].iter().all(|&word| word == round + 1));
                }
            });
        }
    });
}

#[test]
#[should_panic(expected = "the bindings belong to another kernel")]
fn bindings_of_another_kernel_are_refused() {
    let device = open();
    let one = kernel(&device);
    let other = Kernel::from_source(&device, "count", &COUNT.replace("1u", "2u"), "count", &[]).unwrap();
    let bindings = one.bind(&[("words", &zeros(&device))]).unwrap();
    dispatch(&mut Recorder::new(&device).unwrap(), &other, &bindings);
}

/// A renderer follows a scene only on its own device.
#[test]
fn a_device_is_the_same_as_its_clones_alone() {
    let device = open();
    assert!(device.is_same(&device.clone()) && !device.is_same(&open()));
}

#[test]
#[should_panic(expected = "a buffer of another device")]
fn buffers_of_another_device_are_refused() {
    let _ = kernel(&open()).bind(&[("words", &zeros(&open()))]);
}

#[test]
#[should_panic(expected = "words: read past the end")]
fn a_range_past_the_end_is_refused() {
    let _ = zeros(&open()).read(usize::MAX / 2, &mut [0u32]);
}
