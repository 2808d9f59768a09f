// SPDX-License-Identifier: Apache-2.0
// `etude doctor`: can this machine run Etude? Each check is ok, or says what to do.
#include <fmt/format.h>
#include <sys/statvfs.h>

#include "services/bus/network.h"
#include "services/bus/topic.h"
#include "services/cli/command_line.h"
#include "services/cli/doctor_net.h"
#include "services/cli/sibling_text.h"
#include "services/core/clock.h"
#include "services/core/config.h"
#include "services/core/file.h"

namespace etude::cli {
namespace {

using namespace std::chrono_literals;

struct Finding {
  enum class Kind { kOk, kAdvice, kMissing } kind = Kind::kOk;
  std::string text;
};

Finding Ok(std::string text) { return {Finding::Kind::kOk, std::move(text)}; }
Finding Advice(std::string text) { return {Finding::Kind::kAdvice, std::move(text)}; }
Finding Missing(std::string text) { return {Finding::Kind::kMissing, std::move(text)}; }

// Asks a sibling's own doctor.
Finding AskProgram(const std::string& name) {
  const auto answer = AskSibling(name, {"doctor"});
  if (!answer) return Missing(answer.error().message);
  const std::string& text = answer->text;
  return answer->exit_code == 0 ? Ok(text)
                                : Missing(text.empty() ? fmt::format("exit code {}", answer->exit_code) : text);
}

// A message to ourselves and back.
Finding CheckBus(const BusArguments& arguments) {
  auto participant = arguments.Open();
  if (!participant) return Missing(participant.error().message);
  const std::string partition = "doctor-" + bus::UniquePeerName();
  auto reader = bus::Reader<bus::ProcessEvent>::Open(*participant, partition);
  if (!reader) return Missing(reader.error().message);
  auto writer = bus::Writer<bus::ProcessEvent>::Open(*participant, partition);
  if (!writer) return Missing(writer.error().message);
  if (!writer->WaitForReaders(1, 5s)) return Missing("a writer and a reader in one process do not find each other");
  Stopwatch elapsed;
  if (const Status sent = writer->Write({.process = "doctor", .role = "doctor"}); !sent)
    return Missing(sent.error().message);
  if (!reader->Wait(5s) || reader->Take().empty())
    return Missing("a message to this process did not arrive within 5 s");
  return Ok(fmt::format("domain {}, a message there in {:.2f} ms", arguments.domain, 1e3 * elapsed.Seconds()));
}

Finding CheckSocketBuffer() {
  const auto bytes = bus::LargestReceiveBuffer();
  if (!bytes) return Advice("cannot read /proc/sys/net/core/rmem_max");
  if (*bytes >= bus::kWantedReceiveBuffer) return Ok(fmt::format("net.core.rmem_max = {} bytes", *bytes));
  return Advice(
      fmt::format("net.core.rmem_max = {} bytes; large blobs travel faster with: sudo sysctl -w "
                  "net.core.rmem_max={}",
                  *bytes, bus::kWantedReceiveBuffer));
}

Finding CheckDisk() {
  struct statvfs info {};
  std::error_code error;
  const Path here = std::filesystem::current_path(error);
  if (error || ::statvfs(here.c_str(), &info) != 0)
    return Advice("cannot look at the disk of this folder: was it removed? " + here.string());
  const double free_gb = static_cast<double>(info.f_bavail) * static_cast<double>(info.f_frsize) / 1e9;
  // an episode is about 1 MB
  if (free_gb >= 5) return Ok(fmt::format("{:.0f} GB free in {}", free_gb, here.string()));
  return Advice(fmt::format("only {:.1f} GB free in {}; 1000 episodes take about 1 GB", free_gb, here.string()));
}

Status Doctor(const DoctorArguments& arguments) {
  int missing = 0;
  OrderedJson checks = OrderedJson::array();
  const auto report = [&](const char* what, const Finding& finding) {
    const char* word = finding.kind == Finding::Kind::kOk       ? "ok"
                       : finding.kind == Finding::Kind::kAdvice ? "note"
                                                                : "MISSING";
    missing += finding.kind == Finding::Kind::kMissing;
    checks.push_back({{"check", what}, {"state", word}, {"text", finding.text}});
    if (arguments.as_json) return;
    std::string text = finding.text;
    for (std::size_t at = 0; (at = text.find('\n', at)) != std::string::npos; at += 19) text.insert(at + 1, 18, ' ');
    fmt::print("{:<9} {:<7} {}\n", what, word, text);
    std::fflush(stdout);
  };
  report("rendering", AskProgram("etude-worker"));
  report("bus", CheckBus(arguments.bus));
  report("torch", AskProgram("etude-trainer"));
  report("sockets", CheckSocketBuffer());
  report("disk", CheckDisk());
  if (arguments.as_json) fmt::print("{}\n", JsonText(checks, 1));
  if (missing == 0) return {};
  return Fail(Code::kUnavailable, fmt::format("{} of what Etude needs is missing on this machine, see above", missing));
}

}  // namespace

void AddDoctor(CLI::App& app, Body& body) {
  auto* command = app.add_subcommand("doctor", "check rendering, bus, torch, sockets and disk of this machine");
  auto arguments = std::make_shared<DoctorArguments>();
  command->add_flag("--json", arguments->as_json, "as JSON: a list of {check, state, text}");
  arguments->bus.Add(*command);
  const auto* net = AddDoctorNet(*command, arguments, body);
  command->callback([arguments, net, &body] {
    if (!*net) body = [arguments] { return Doctor(*arguments); };
  });
}

}  // namespace etude::cli
