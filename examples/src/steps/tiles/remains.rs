//! What processes with the same outputs leave when they are ended: whoever still lives clears all of it away.

use std::path::PathBuf;
use std::sync::Arc;

use geom_core::tiles::Exchange;
use signal_hook::consts::SIGTERM;
use signal_hook::iterator::Signals;

use crate::{Failure, Session};

/// The folders in which the outputs of all ranks wait, each with the topmost folder that had to be made for it.
pub struct Remains(Vec<(PathBuf, Option<PathBuf>)>);

/// How often it is tried: somebody may still be writing.
const TRIES: u32 = 3;

impl Remains {
    /// Those of all ranks, which all ask for together.
    pub fn of(exchange: &dyn Exchange, session: &Session) -> Result<Arc<Self>, Failure> {
        let own = serde_json::to_vec(&session.waiting()?)?;
        let all = exchange.gather(&own)?;
        let all = all.iter().map(|one| serde_json::from_slice(one));
        Ok(Arc::new(Self(all.collect::<Result<_, _>>()?)))
    }

    /// Clears them away, and ends this process, when it is told to end: as `mpirun` does where a rank has died, and kills
    /// who has not ended a second later.
    pub fn watch(self: &Arc<Self>) -> Result<(), Failure> {
        let mut signals = Signals::new([SIGTERM])?;
        let remains = self.clone();
        std::thread::spawn(move || {
            if signals.forever().next().is_some() {
                remains.clear();
                std::process::exit(128 + SIGTERM);
            }
        });
        Ok(())
    }

    /// Clears them away, as well as that goes.
    pub fn clear(&self) {
        for (folder, made) in &self.0 {
            for _ in 0..TRIES {
                if std::fs::remove_dir_all(folder).is_ok() || !folder.exists() {
                    break;
                }
            }
            // What was made for them goes too, if nothing is in it.
            let above = folder.ancestors().skip(1);
            let made = made.as_deref();
            for folder in above.take_while(|a| made.is_some_and(|made| a.starts_with(made))) {
                if std::fs::remove_dir(folder).is_err() {
                    break;
                }
            }
        }
    }
}
