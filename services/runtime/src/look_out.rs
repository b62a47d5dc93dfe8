//! The look-out of a program in another language between the sleeps of a wait: for signals, and whether the process that stands for it still lives.

use std::cell::{Cell, RefCell};

use rustix::process::{Pid, test_kill_process};

use crate::clock::now_ns;

/// The longest sleep of a process that looks out; ns.
const EVERY_NS: u64 = 25_000_000;

/// Of every other process: nothing.
#[derive(Default)]
pub(crate) struct LookOut {
    is_used: Cell<bool>,
    call: RefCell<Option<Box<dyn FnMut() -> bool>>>,
    /// The process that the launcher has started in its place.
    stands_for: Cell<Option<Pid>>,
    last_ns: Cell<u64>,
}

impl LookOut {
    /// From now on `call` is made between sleeps; it returns whether the wait goes on.
    pub(crate) fn call(&self, call: impl FnMut() -> bool + 'static) {
        self.is_used.set(true);
        self.call.replace(Some(Box::new(call)));
    }

    /// From now on a wait ends when this process has.
    pub(crate) fn watch(&self, pid: Option<Pid>) {
        self.is_used.set(true);
        self.stands_for.set(pid);
    }

    /// How long a sleep may last.
    pub(crate) fn limited(&self, sleep_ns: Option<u64>) -> Option<u64> {
        match self.is_used.get() {
            true => Some(sleep_ns.map_or(EVERY_NS, |ns| ns.min(EVERY_NS))),
            false => sleep_ns,
        }
    }

    /// After a sleep: why the wait ends here, where it does.
    pub(crate) fn look(&self) -> Option<&'static str> {
        if !self.is_used.get() {
            return None;
        }
        let now = now_ns();
        if now < self.last_ns.get() + EVERY_NS {
            return None;
        }
        self.last_ns.set(now);
        if self
            .stands_for
            .get()
            .is_some_and(|pid| test_kill_process(pid).is_err())
        {
            return Some("armplane is gone");
        }
        let mut call = self.call.borrow_mut();
        let goes_on = call.as_mut().is_none_or(|call| call());
        (!goes_on).then_some("its program looks to something else")
    }
}
