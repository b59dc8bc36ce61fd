//! The table: forward, one decision and training step at each size, with our operators and with Burn's.

use crate::clock::median;
use crate::work::{Row, Task};
use crate::worker::Worker;
use crate::{Failure, Operators};
use serde_json::{Value, json};

/// Prints a line for each row and set of operators; returns their figures.
pub(crate) fn measure(rows: &[Row], turns: usize, burn_too: bool) -> Result<Vec<Value>, Failure> {
    println!("milliseconds on the clock (of the processor), medians of {turns} turns; peak memory of a process, MiB\n");
    print!("{:<17}{:<11}{:>18}{:>8}", "side/base/batch", "operators", "forward", "MiB");
    println!("{:>18}{:>8}{:>20}{:>8}{:>11}", "one decision", "MiB", "training step", "MiB", "samples/s");
    let mut figures = Vec::new();
    for (number, &row) in rows.iter().enumerate() {
        // Burn's own take long at the larger sizes.
        let all = [Operators::Ours, Operators::Burn];
        let operators = if burn_too || number == 0 && rows.len() > 1 { &all[..] } else { &all[..1] };
        let mut cells = vec![Vec::new(); operators.len()];
        for task in Task::ALL {
            let start = |&operators| Worker::start(task, row, operators);
            let mut workers = operators.iter().map(start).collect::<Result<Vec<_>, _>>()?;
            for _ in 0..turns {
                workers.iter_mut().try_for_each(Worker::turn)?;
            }
            for (cells, worker) in cells.iter_mut().zip(&mut workers) {
                let wall = median(worker.times.iter().map(|time| time.wall));
                let cpu = median(worker.times.iter().map(|time| time.cpu));
                cells.push((task, wall, cpu, worker.memory()?));
            }
        }
        for (operators, cells) in operators.iter().zip(cells) {
            print!("{row:<17}{:<11}", operators.name());
            let mut figure = json!({ "row": row.to_string(), "operators": operators.name() });
            for (task, wall, cpu, memory) in cells {
                let width = if task == Task::Train { 20 } else { 18 };
                print!("{:>width$}{memory:>8.0}", format!("{:.1} ({:.1})", 1e3 * wall, 1e3 * cpu));
                if task == Task::Train {
                    print!("{:>11.1}", row.batch as f64 / wall);
                }
                figure[task.name()] = json!({ "seconds": wall, "cpu_seconds": cpu, "peak_mib": memory });
            }
            println!();
            figures.push(figure);
        }
    }
    Ok(figures)
}
