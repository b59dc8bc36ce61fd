//! Work in a process of its own: memory of one piece of work does not hide in that of another, and several workers can be
//! asked in turns, so that a busy machine disturbs all alike.

use crate::clock::{Time, median, peak_memory};
use crate::work::{Row, Task, Work};
use crate::{Failure, Operators, sgemm_peak};
use nbp_model::fast;
use std::io::{BufRead, BufReader, Lines, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

/// Answers each line of standard input: `N` does the work once untimed, to bring its memory back to the caches, and then
/// N times: `median seconds on the clock, mean seconds of the processor, first check`, see [`Work::step`]. `memory`: the
/// most that was held at once, MiB. `sgemm`: what the machine can do, see [`sgemm_peak`].
pub(crate) fn serve(task: Task, row: Row, operators: Operators) -> Result<(), Failure> {
    fast::enable(operators == Operators::Ours);
    let mut work = Work::new(task, row)?;
    for line in std::io::stdin().lines() {
        match line?.trim() {
            "memory" => println!("{}", peak_memory()),
            "sgemm" => println!("{}", sgemm_peak()),
            number => {
                let count: usize = number.parse().map_err(|_| format!("`{number}`: say a number, memory or sgemm"))?;
                let first = work.step()?;
                let mut times = Vec::new();
                for _ in 0..count {
                    let (time, check) = Time::of(|| work.step());
                    check?;
                    times.push(time);
                }
                let cpu = times.iter().map(|time| time.cpu).sum::<f64>() / count as f64;
                println!("{} {cpu} {first}", median(times.iter().map(|time| time.wall)));
            }
        }
        std::io::stdout().flush()?;
    }
    Ok(())
}

/// The other end of [`serve`].
pub(crate) struct Worker {
    child: Child,
    questions: ChildStdin,
    answers: Lines<BufReader<ChildStdout>>,
    pub(crate) times: Vec<Time>,
    /// Calls in a turn.
    calls: usize,
}

impl Worker {
    /// Starts it and has it do the work once.
    pub(crate) fn start(task: Task, row: Row, operators: Operators) -> Result<Self, Failure> {
        let mut command = Command::new(std::env::current_exe()?);
        command.args(["--serve", task.name(), &row.to_string(), operators.name()]);
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn()?;
        let (Some(questions), Some(answers)) = (child.stdin.take(), child.stdout.take()) else {
            return Err("a worker without pipes".into());
        };
        let answers = BufReader::new(answers).lines();
        let mut worker = Self { child, questions, answers, times: Vec::new(), calls: 1 };
        let warm_up = worker.ask("1")?;
        // Short work is done several times in a turn.
        worker.calls = (0.3 / warm_up.first().copied().unwrap_or(1.0)).clamp(1.0, 20.0) as usize;
        Ok(worker)
    }

    fn ask(&mut self, question: &str) -> Result<Vec<f64>, Failure> {
        writeln!(self.questions, "{question}")?;
        let answer = self.answers.next().ok_or("a worker broke off")??;
        Ok(answer.split(' ').map(str::parse).collect::<Result<_, _>>()?)
    }

    pub(crate) fn turn(&mut self) -> Result<(), Failure> {
        match self.ask(&self.calls.to_string())?[..] {
            [wall, cpu, _] => self.times.push(Time { wall, cpu }),
            _ => return Err("a worker answers in another language".into()),
        }
        Ok(())
    }

    /// MiB.
    pub(crate) fn memory(&mut self) -> Result<f64, Failure> {
        Ok(self.ask("memory")?.first().copied().unwrap_or(f64::NAN))
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
