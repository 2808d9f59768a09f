// SPDX-License-Identifier: Apache-2.0
// What every program of Etude does the same way: exit codes, the one catch-all, common options.
#pragma once

#include <functional>
#include <string>

#include "services/core/result.h"

namespace etude {

/// 0 done; 2 usage (bad flag, file or key); 3 the machine cannot (no GL, no DDS, disk full); 141 nobody reads what
/// it prints any more (`etude … | head`): what a shell says of a program that SIGPIPE ended; 1 anything else.
enum ExitCode : int { kExitOk = 0, kExitFailure = 1, kExitUsage = 2, kExitMachine = 3, kExitUnread = 128 + 13 };

int ExitCodeFor(const Error& error);
/// The other way round, of a child of ours that failed: kInvalidArgument, kUnavailable or kInternal.
Code CodeForExit(int exit_code);

/// Runs a program's body: installs the stop signals and the log, prints an Error once as
/// "NAME: message", and turns what libraries throw past their owners into exit code 1 (in a thread: into its words and
/// SIGABRT). SIGPIPE stays ignored, so that a socket whose peer has gone ends no service; a standard output that nobody
/// reads ends the command where it next prints, without a word and with what it holds released. What is printed but
/// cannot be written is an error.
int RunMain(const std::string& name, const std::function<Status()>& body);

/// Etude's version, "0.1.0"; peers of another version are refused by name.
std::string Version();
/// The same with the commit that it was built from, "0.1.0+89abcdef0123", where the build knows it (ETUDE_DEV=OFF): for
/// people and logs, never compared.
std::string BuildVersion();

}  // namespace etude
