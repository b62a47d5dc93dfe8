//! The two ends of each transport, for every size of message.

use std::error::Error;
use std::fs::OpenOptions;
use std::os::fd::AsRawFd;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU32, Ordering};
use std::{env, ptr, slice};

use iceoryx2::prelude::*;
use zenoh::Wait;
use zenoh::qos::CongestionControl;
use zenoh::shm::{BlockOn, GarbageCollect, ShmProviderBuilder};

use super::SIZES;

pub type Failure = Box<dyn Error + Send + Sync>;

/// Sends the message of a number; waits for a message and gives its number.
pub struct Ends {
    pub send: Box<dyn FnMut(u64) -> Result<(), Failure>>,
    pub receive: Box<dyn FnMut() -> Result<u64, Failure>>,
}

/// The ends of a process, one of each size; none if the library answers on a thread of its own.
pub fn open(name: &str, me: usize) -> Result<Vec<Ends>, Failure> {
    match name {
        "futex" => SIZES.iter().map(|(bytes, _)| futex(me, *bytes)).collect(),
        "iceoryx2" => iceoryx2(me),
        "zenoh" => zenoh(me),
        _ => Err(format!("there is no peer {name}").into()),
    }
}

/// The number, in every word of a message.
fn write(message: &mut [u8], number: u64) {
    for word in message.chunks_exact_mut(8) {
        word.copy_from_slice(&number.to_ne_bytes());
    }
}

fn read(message: &[u8]) -> Result<u64, Failure> {
    let words = || {
        message
            .as_chunks()
            .0
            .iter()
            .map(|word| u64::from_ne_bytes(*word))
    };
    let number = words().next().ok_or("an empty message")?;
    match words().fold(0, |differs, word| differs | (word ^ number)) {
        0 => Ok(number),
        _ => Err("a torn message".into()),
    }
}

fn folder() -> Result<PathBuf, Failure> {
    Ok(env::var("PEERS_FOLDER")?.into())
}

/// A message in shared memory behind a count, on which the reader sleeps and which the writer always wakes.
fn futex(me: usize, bytes: usize) -> Result<Ends, Failure> {
    const HEAD: usize = 64;
    let map = |from: usize| -> Result<(&'static AtomicU32, *mut u8), Failure> {
        let path = folder()?.join(format!("{bytes}-{from}"));
        let file = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .open(path)?;
        file.set_len((HEAD + bytes) as u64)?;
        let access = libc::PROT_READ | libc::PROT_WRITE;
        // SAFETY: a fresh shared mapping of a file of this size, of plain bytes, for as long as the process lives.
        unsafe {
            let place = libc::mmap(
                ptr::null_mut(),
                HEAD + bytes,
                access,
                libc::MAP_SHARED,
                file.as_raw_fd(),
                0,
            );
            if place == libc::MAP_FAILED {
                return Err(std::io::Error::last_os_error().into());
            }
            Ok((&*place.cast(), place.cast::<u8>().add(HEAD)))
        }
    };
    let ((sent, outbox), (came, inbox)) = (map(me)?, map(1 - me)?);
    let call = |count: &AtomicU32, operation: i32, value: u32| {
        let no_limit = ptr::null::<libc::timespec>();
        // SAFETY: the count lives as long as the process.
        unsafe { libc::syscall(libc::SYS_futex, count.as_ptr(), operation, value, no_limit) };
    };
    let mut seen = 0;
    Ok(Ends {
        send: Box::new(move |number| {
            // SAFETY: the reader looks at these bytes only after the count has changed, and answers before we write again.
            write(unsafe { slice::from_raw_parts_mut(outbox, bytes) }, number);
            sent.fetch_add(1, Ordering::Release);
            call(sent, libc::FUTEX_WAKE, 1);
            Ok(())
        }),
        receive: Box::new(move || {
            while came.load(Ordering::Acquire) == seen {
                call(came, libc::FUTEX_WAIT, seen);
            }
            seen += 1;
            // SAFETY: as above.
            read(unsafe { slice::from_raw_parts(inbox, bytes) })
        }),
    })
}

/// Publish-subscribe with the library's own events: a notifier wakes a listener.
fn iceoryx2(me: usize) -> Result<Vec<Ends>, Failure> {
    let mut config = Config::default();
    let folder = folder()?;
    let name = folder.file_name().unwrap_or_default().to_string_lossy();
    config.global.prefix = FileName::new(format!("{name}_").as_bytes())?;
    config
        .global
        .set_root_path(&Path::new(folder.as_os_str().as_encoded_bytes())?);
    let node = NodeBuilder::new()
        .config(&config)
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create::<ipc::Service>()?;
    let both = SIZES.iter().map(|(bytes, _)| {
        let bytes = *bytes;
        let service = |from: usize| {
            let name = ServiceName::new(&format!("{bytes}-{from}"))?;
            let topic = node.service_builder(&name).publish_subscribe::<[u8]>();
            let topic = topic
                .history_size(0)
                .subscriber_max_borrowed_samples(1)
                .open_or_create()?;
            // With the default of 255 events a wake-up takes three times as long.
            let event = node
                .service_builder(&name)
                .event()
                .event_id_max_value(7)
                .open_or_create()?;
            Ok::<_, Failure>((topic, event))
        };
        let ((topic, event), (other_topic, other_event)) = (service(me)?, service(1 - me)?);
        let publisher = topic
            .publisher_builder()
            .initial_max_slice_len(bytes)
            .create()?;
        let notifier = event.notifier_builder().create()?;
        let subscriber = other_topic.subscriber_builder().create()?;
        let listener = other_event.listener_builder().create()?;
        Ok(Ends {
            send: Box::new(move |number| {
                let sample = publisher.loan_slice_uninit(bytes)?;
                // SAFETY: the memory is a mapped file, whose bytes are those of an earlier message or zero.
                let mut sample = unsafe { sample.assume_init() };
                write(sample.payload_mut(), number);
                sample.send()?;
                notifier.notify()?;
                Ok(())
            }),
            receive: Box::new(move || {
                loop {
                    if let Some(sample) = subscriber.receive()? {
                        return read(&sample);
                    }
                    listener.blocking_wait(|_| {})?;
                }
            }),
        })
    });
    both.collect()
}

/// As in the library's ping and pong, over one loopback connection; every message is in shared memory, and the second end answers in the callback.
fn zenoh(me: usize) -> Result<Vec<Ends>, Failure> {
    let port = env::var("PEERS_PORT")?;
    let mut config = zenoh::Config::default();
    let (listen, connect) = match me {
        0 => (port, "[]".to_owned()),
        _ => ("0".to_owned(), format!(r#"["tcp/127.0.0.1:{port}"]"#)),
    };
    config.insert_json5("mode", r#""peer""#)?;
    config.insert_json5("scouting/multicast/enabled", "false")?;
    config.insert_json5(
        "listen/endpoints",
        &format!(r#"["tcp/127.0.0.1:{listen}"]"#),
    )?;
    config.insert_json5("connect/endpoints", &connect)?;
    config.insert_json5("transport/shared_memory/enabled", "true")?;
    let session = zenoh::open(config).wait()?;
    let mut all = Vec::new();
    for (bytes, _) in SIZES {
        let memory = ShmProviderBuilder::default_backend(8 * bytes.max(4096)).wait()?;
        let publisher = session
            .declare_publisher(format!("{bytes}/{me}"))
            .congestion_control(CongestionControl::Block)
            .express(true)
            .wait()?;
        let send = move |number| -> Result<(), Failure> {
            let mut message = memory
                .alloc(bytes)
                .with_policy::<BlockOn<GarbageCollect>>()
                .wait()?;
            write(&mut message, number);
            publisher.put(message).wait()
        };
        let number = |sample: zenoh::sample::Sample| -> Result<u64, Failure> {
            let payload = sample.payload();
            payload
                .as_shm()
                .ok_or("a message outside of shared memory")?;
            read(&payload.to_bytes())
        };
        let subscriber = session.declare_subscriber(format!("{bytes}/{}", 1 - me));
        if me == 1 {
            let answer = move |sample| {
                if let Err(failure) = number(sample).and_then(&send) {
                    eprintln!("zenoh: {failure}");
                }
            };
            subscriber.callback(answer).background().wait()?;
        } else {
            let subscriber = subscriber.wait()?;
            all.push(Ends {
                send: Box::new(send),
                receive: Box::new(move || number(subscriber.recv()?)),
            });
        }
    }
    // Until the process ends.
    std::mem::forget(session);
    Ok(all)
}
