//! `infer`: explore scenes with a policy, compare policies, and bring weights in.

mod cli;

fn main() -> std::process::ExitCode {
    cli::main()
}
