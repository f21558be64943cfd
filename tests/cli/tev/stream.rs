//! The stream of snapshots, without the program.

use std::io::Read;
use std::net::TcpListener;
use std::thread::{sleep, spawn};
use std::time::{Duration, Instant};

use taugate::internals::image::channels::ChannelGroup;
use taugate::internals::tev::{Snapshot, TevStream};

use super::viewer::{listen, read_packet, show};

const SECOND: Duration = Duration::from_secs(1);

/// An image of a colour and a depth, with a gradient.
fn snapshot(name: &str, [width, height]: [u32; 2]) -> Snapshot {
    let ramp = |channels: u32| (0..width * height * channels).map(|i| i as f32).collect();
    let groups = vec![ChannelGroup::rgb("", ramp(3)), ChannelGroup::single("depth.Z".into(), ramp(1))];
    Snapshot { name: name.into(), width, height, groups }
}

/// Sends a snapshot and waits for its end.
fn send(stream: &mut TevStream, snapshot: &Snapshot) -> Option<String> {
    stream.offer_last(|| snapshot.clone());
    stream.finish(30 * SECOND)
}

/// A socket that takes few bytes before its client must wait.
#[cfg(unix)]
pub fn shrink(listener: &TcpListener) {
    use std::os::fd::AsRawFd;
    let size: libc::c_int = 4096;
    let length = size_of_val(&size) as libc::socklen_t;
    // SAFETY: the option takes an int, and `size` is one.
    let result = unsafe {
        libc::setsockopt(listener.as_raw_fd(), libc::SOL_SOCKET, libc::SO_RCVBUF, (&raw const size).cast(), length)
    };
    assert_eq!(result, 0);
}

#[test]
fn only_tiles_that_changed_are_sent() {
    let (listener, address) = listen();
    let viewer = show(listener);
    let mut stream = TevStream::new(address.parse().unwrap());
    let mut image = snapshot("a", [300, 130]);
    assert_eq!(send(&mut stream, &image), None);
    assert_eq!(send(&mut stream, &image), None);
    // Pixel 299, 129: the last tile, of 44 x 2 pixels.
    *image.groups[0].values.last_mut().unwrap() = -1.0;
    assert_eq!(send(&mut stream, &image), None);
    drop(stream);

    let mut viewer = viewer.join().unwrap();
    assert_eq!(viewer.created, ["a"]);
    let shown = viewer.images.remove("a").unwrap();
    let rgb = ["R", "G", "B"].map(String::from).to_vec();
    let tiles: Vec<[usize; 4]> = [
        [0, 0, 128, 128],
        [128, 0, 128, 128],
        [256, 0, 44, 128],
        [0, 128, 128, 2],
        [128, 128, 128, 2],
        [256, 128, 44, 2],
    ]
    .into();
    let colours = tiles.iter().map(|tile| (rgb.clone(), *tile));
    let depths = tiles.iter().map(|tile| (vec!["depth.Z".to_string()], *tile));
    let last = (rgb.clone(), [256, 128, 44, 2]);
    assert_eq!(shown.updates, colours.chain(depths).chain([last]).collect::<Vec<_>>());
    for group in image.groups {
        for (name, values) in group.into_channels() {
            assert!(shown.channels[&name] == values, "{name}");
        }
    }
}

#[test]
fn another_size_name_or_channel_is_another_image() {
    let (listener, address) = listen();
    let viewer = show(listener);
    let mut stream = TevStream::new(address.parse().unwrap());
    let mut more = snapshot("a", [5, 5]);
    more.groups.push(ChannelGroup::single("late.Z".into(), vec![7.0; 25]));
    for image in [snapshot("a", [4, 4]), snapshot("a", [5, 5]), more, snapshot("b", [5, 5]), snapshot("b", [5, 5])] {
        assert_eq!(send(&mut stream, &image), None);
    }
    drop(stream);
    let viewer = viewer.join().unwrap();
    assert_eq!(viewer.created, ["a", "a", "a", "b"]);
    assert_eq!((viewer.images["a"].channels.len(), &viewer.images["a"].channels["late.Z"]), (5, &vec![7.0; 25]));
    assert_eq!((viewer.images["b"].channels.len(), viewer.images["b"].updates.len()), (4, 2));
}

/// A snapshot without all its values is a defect of the caller. The stream warns and does not panic.
#[test]
fn incomplete_images_are_not_sent() {
    let (listener, address) = listen();
    let viewer = show(listener);
    let mut stream = TevStream::new(address.parse().unwrap());
    let mut image = snapshot("a", [4, 4]);
    image.groups[1].values.pop();
    let warning = send(&mut stream, &image).unwrap();
    assert!(warning.contains("the image is not complete"), "{warning}");
    assert!(viewer.join().unwrap().created.is_empty());
}

#[test]
fn offers_are_rare_and_cost_nothing_in_between() {
    let (listener, address) = listen();
    let viewer = show(listener);
    let mut stream = TevStream::new(address.parse().unwrap());
    assert_eq!(send(&mut stream, &snapshot("a", [4, 4])), None);
    let (mut made, start) = (0, Instant::now());
    while start.elapsed() < SECOND {
        stream.offer(|| {
            made += 1;
            // The next snapshot comes at least 300 times this time later.
            sleep(Duration::from_millis(2));
            snapshot("a", [4, 4])
        });
        sleep(Duration::from_millis(1));
    }
    // On a busy machine, more than a second has passed.
    let most = 1 + (start.elapsed().as_secs_f64() / 0.6) as usize;
    assert!((1..=most).contains(&made), "{made} snapshots in {:?}", start.elapsed());
    drop(stream);
    viewer.join().unwrap();
}

#[cfg(unix)]
#[test]
fn a_tev_that_reads_nothing_delays_the_end_once() {
    let (listener, address) = listen();
    shrink(&listener);
    let mut stream = TevStream::new(address.parse().unwrap());
    let _unread = listener.accept().unwrap();
    let large = snapshot("a", [1500, 1500]);
    stream.offer_last(|| large.clone());
    let start = Instant::now();
    let warning = stream.finish(SECOND).unwrap();
    assert!(warning.contains("did not take the whole image within 1 s"), "{warning}");
    assert!((SECOND..20 * SECOND).contains(&start.elapsed()), "{:?}", start.elapsed());
    // The next frame of a sequence neither waits nor warns again, and the mailbox holds one snapshot at most.
    let start = Instant::now();
    for _ in 0..100 {
        stream.offer(|| unreachable!("tev does not take the snapshot before"));
    }
    stream.offer_last(|| large);
    // A stream that waits would wait for a minute.
    assert_eq!(stream.finish(60 * SECOND), None);
    drop(stream);
    assert!(start.elapsed() < 20 * SECOND, "{:?}", start.elapsed());
}

/// tev is closed and started again. The user hears of it once, and sees the whole image again.
#[test]
fn a_tev_that_comes_back_gets_the_whole_image() {
    let (listener, address) = listen();
    let mut stream = TevStream::new(address.parse().unwrap());
    let mut first = listener.accept().unwrap().0;
    let image = snapshot("a", [200, 10]);
    stream.offer_last(|| image.clone());
    // Creation, two tiles of colours, two of depths.
    (0..5).for_each(|_| drop(read_packet(&mut first).unwrap()));
    assert_eq!(stream.finish(30 * SECOND), None);
    drop(first);
    let warning = send(&mut stream, &image).unwrap();
    assert!(warning.contains(&format!("tev at {address} is gone")), "{warning}");

    let viewer = show(listener);
    let start = Instant::now();
    let mut is_offered = false;
    while !is_offered {
        assert!(start.elapsed() < 60 * SECOND, "it does not connect again");
        stream.offer(|| {
            is_offered = true;
            image.clone()
        });
        sleep(Duration::from_millis(10));
    }
    assert_eq!(stream.finish(30 * SECOND), None);
    drop(stream);
    assert_eq!(viewer.join().unwrap().images["a"].updates.len(), 4);
}

/// If the connection ends in the middle of a packet, this is one warning too.
#[test]
fn a_tev_that_ends_within_a_packet_is_one_warning() {
    let (listener, address) = listen();
    let tev = spawn(move || {
        let mut stream = listener.accept().unwrap().0;
        stream.read_exact(&mut [0; 100_000]).unwrap();
    });
    let mut stream = TevStream::new(address.parse().unwrap());
    let warning = send(&mut stream, &snapshot("a", [1500, 1500])).unwrap();
    assert!(warning.contains("is gone"), "{warning}");
    tev.join().unwrap();
    // The stream tries to connect again, in vain, and does not report this.
    sleep(3 * SECOND);
    assert_eq!((send(&mut stream, &snapshot("a", [4, 4])), stream.warning()), (None, None));
}
