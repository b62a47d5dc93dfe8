//! Results that steps on one thread need not compute twice.

use std::any::Any;

/// Values by their type, of which a step may find one that a step before it has left. Whether it does changes no output, only the time: a value is used
/// where it is exactly what the step would compute itself.
#[derive(Debug, Default)]
pub struct Scratch(Vec<Box<dyn Any + Send>>);

impl Scratch {
    /// The value of this type, made where there is none yet.
    #[inline]
    pub fn of<T: Any + Send>(&mut self, make: impl FnOnce() -> T) -> &mut T {
        let found = self.0.iter().position(|value| value.is::<T>());
        let place = found.unwrap_or_else(|| {
            self.0.push(Box::new(make()));
            self.0.len() - 1
        });
        match self.0[place].downcast_mut() {
            Some(value) => value,
            None => unreachable!("it was found, or made, as this type"),
        }
    }
}
