// SPDX-License-Identifier: Apache-2.0
// Where on the bus a program is: the options that all programs share. For mains only (CLI11).
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "services/bus/participant.h"
#include "services/core/identity.h"
#include "services/core/log_format.h"
#include "services/security/checkpoint_signature.h"
#include "services/security/identity.h"

namespace etude::bus {

/// `--new-id` and `--adopt`: what a start does when its folder's id is live elsewhere.
inline void AddClaim(CLI::App& app, Claim& claim) {
  auto* new_id = app.add_flag_callback(
      "--new-id", [&claim] { claim = Claim::kNewId; }, "the folder is a copy: give it an id of its own");
  auto* adopt = app.add_flag_callback(
      "--adopt", [&claim] { claim = Claim::kAdopt; }, "go on in the place of the one that has this folder's id");
  new_id->excludes(adopt);
}

/// `--verify` and `--floor`.
inline void AddVerify(CLI::App& app, security::VerifyArguments& verify) {
  app.add_option("--verify", verify.key, "take only checkpoints signed by this Ed25519 key (FILE.pub)");
  app.add_option(
      "--floor", verify.floor,
      "with --verify: file of the newest versions taken, older ones are refused (default: in ~/.local/state)");
}

struct Arguments {
  std::uint32_t domain = 0;
  std::string profile;  ///< empty: $CYCLONEDDS_URI, else this machine only
  std::string log = "text";
  std::string security;  ///< folder of the identity; empty: without security

  void Add(CLI::App& app) {
    app.add_option("--domain", domain, "DDS domain, 0..230")->check(CLI::Range(0, 230))->capture_default_str();
    app.add_option("--profile", profile, "Cyclone DDS XML file (default: this machine only)");
    AddSecurity(app, security);
    AddLog(app, log);
  }
  /// `--security`: the identity of this process; those that it starts get theirs from it (Flags).
  static void AddSecurity(CLI::App& app, std::string& security) {
    app.add_option("--security", security, "who this is on a secured bus: DIR/NAME of `etude security issue`")
        ->envname("ETUDE_SECURITY");
  }
  /// `--log`: how this process and those that it starts write their log.
  static void AddLog(CLI::App& app, std::string& log) {
    app.add_option_function<std::string>(
           "--log",
           [&log](const std::string& format) {
             log = format;
             SetLogFormat(format == "json" ? LogFormat::kJson : LogFormat::kText);
           },
           "text | json: the log on stderr, a JSON object a line for programs")
        ->check(CLI::IsMember({"text", "json"}));
  }
  /// @param roles  what the process does on the bus: its identity, if it has one, must allow that
  /// @error as Participant::Open.
  Result<Participant> Open(const std::vector<security::Role>& roles = {}) const {
    return Participant::Open(Config(roles));
  }
  ParticipantConfig Config(const std::vector<security::Role>& roles) const {  // what Open opens, to be said more of
    return {.domain = domain, .profile = profile, .security = security, .roles = roles};
  }
  /// The same for a child in a role: its command line, and its environment. Its identity is this one when that has the
  /// role, else the neighbour of the role's name.
  std::vector<std::string> Flags(security::Role role) const {
    std::vector<std::string> flags{"--domain", std::to_string(domain)};
    if (!security.empty()) flags.insert(flags.end(), {"--security", security::IdentityFor(security, role).string()});
    if (log != "text") flags.insert(flags.end(), {"--log", log});
    return flags;
  }
  /// What a command that is shown has to say to meet this process: " --domain 7 --security fleet/me"; "" where nothing.
  std::string Words() const {
    std::string words = domain == 0 ? "" : " --domain " + std::to_string(domain);
    if (!profile.empty()) words += " --profile " + profile;
    if (!security.empty()) words += " --security " + security;
    return words;
  }
  std::map<std::string, std::string> Environment() const {
    if (profile.empty()) return {};
    return {{"CYCLONEDDS_URI", profile}};
  }
};

}  // namespace etude::bus
