// SPDX-License-Identifier: Apache-2.0
// `etude security init|issue|revoke|show|signing-key`.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include "services/bus/access.h"
#include "services/cli/command_line.h"
#include "services/core/clock.h"
#include "services/core/config.h"
#include "services/security/authority.h"
#include "services/security/checkpoint_signature.h"
#include "services/security/identity.h"

namespace etude::cli {
namespace {

constexpr double kDay = 86400;

struct InitArguments {
  std::string folder, protect = "encrypt";
};

Status Init(const InitArguments& arguments) {
  const auto protection = arguments.protect == "sign" ? security::Protection::kSign : security::Protection::kEncrypt;
  ETUDE_RETURN_IF_ERROR(security::InitAuthority(arguments.folder, protection));
  fmt::print("{0}: two authorities, valid for 10 years\nkeep {0}/ca off the hosts: who has it lets anybody in\n",
             arguments.folder);
  return {};
}

struct IssueArguments {
  std::string folder, name;
  std::vector<std::string> roles, campaigns, runs;
  std::vector<std::uint32_t> domains;
  double days = 30;
};

Status IssueIdentity(const IssueArguments& arguments) {
  const auto now = static_cast<std::int64_t>(WallSeconds());
  security::IssueOptions options{.name = arguments.name,
                                 .campaigns = arguments.campaigns,
                                 .runs = arguments.runs,
                                 .domains = arguments.domains,
                                 .not_before = now - 60,  // clocks of hosts differ
                                 .not_after = now + static_cast<std::int64_t>(arguments.days * kDay)};
  for (const auto& text : arguments.roles) {
    ETUDE_ASSIGN_OR_RETURN(const security::Role role, security::ParseRole(text));
    options.roles.push_back(role);
  }
  options.grants = bus::GrantsFor(options.roles, options.name, options.campaigns, options.runs);
  ETUDE_ASSIGN_OR_RETURN(const Path identity, security::Issue(arguments.folder, options));
  fmt::print("{}\n", identity.string());
  return {};
}

Status RevokeIdentity(const std::string& folder, const std::string& name) {
  ETUDE_RETURN_IF_ERROR(security::Revoke(folder, name));
  fmt::print(
      "revoked '{}'. The list is read when a process starts: copy {}/public/crl.pem into the identities on other "
      "hosts,\n"
      "and restart whoever must not hear it any more (collector, trainer and policy servers first)\n",
      name, folder);
  return {};
}

std::string StateText(const security::Issued& item, std::int64_t now) {
  if (item.revoked) return "revoked " + security::UtcText(*item.revoked);
  if (item.not_after <= now) return "expired " + security::UtcText(item.not_after);
  return fmt::format("{:.1f} days left", static_cast<double>(item.not_after - now) / kDay);
}

std::string NamesText(const std::vector<std::string>& names) {
  return names.empty() ? "any" : fmt::format("{}", fmt::join(names, ","));
}

// Times in seconds since 1970; "campaigns", "runs" and "domains" without one: any.
OrderedJson JsonOf(const security::Issued& item, std::int64_t now) {
  return {{"name", item.name},
          {"serial", item.serial},
          {"roles", item.roles},
          {"campaigns", item.campaigns},
          {"runs", item.runs},
          {"domains", item.domains},
          {"not_before", item.not_before},
          {"not_after", item.not_after},
          {"revoked", item.revoked ? OrderedJson(*item.revoked) : OrderedJson()},
          {"state", item.revoked            ? "revoked"
                    : item.not_after <= now ? "expired"
                                            : "valid"}};
}

Status ShowAuthority(const std::string& folder, bool as_json) {
  ETUDE_ASSIGN_OR_RETURN(const auto issued, security::ReadIssued(folder));
  const auto now = static_cast<std::int64_t>(WallSeconds());
  if (as_json) {
    OrderedJson all = OrderedJson::array();
    for (const auto& item : issued) all.push_back(JsonOf(item, now));
    fmt::print("{}\n", JsonText(all, 1));
    return {};
  }
  for (const auto& item : issued)
    fmt::print("{:<20} {:<24} campaigns {:<12} runs {:<12} domains {:<8} {}\n", item.name,
               fmt::format("{}", fmt::join(item.roles, ",")), NamesText(item.campaigns), NamesText(item.runs),
               item.domains.empty() ? "any" : fmt::format("{}", fmt::join(item.domains, ",")), StateText(item, now));
  if (issued.empty()) fmt::print("nothing issued yet\n");
  return {};
}

Status MakeKey(const std::string& file) {
  ETUDE_RETURN_IF_ERROR(security::MakeSigningKey(file));
  fmt::print(
      "{0}      for etude train --sign; keep it where only the trainer is\n{0}.pub  for --verify of subscribers\n",
      file);
  return {};
}

void AddIssue(CLI::App& command, Body& body) {
  auto arguments = std::make_shared<IssueArguments>();
  auto* issue = command.add_subcommand("issue", "make DIR/NAME, the identity of one process or host");
  issue->add_option("dir", arguments->folder, "folder of the authority")->required();
  issue
      ->add_option("--role", arguments->roles,
                   "collector | worker | trainer | policy | subscriber | robot | gateway | relay; may be repeated")
      ->required()
      ->allow_extra_args(false);
  issue
      ->add_option("--name", arguments->name,
                   "[a-z0-9-], once in an authority; of a worker or robot also the name of its host")
      ->required();
  issue->add_option("--campaign", arguments->campaigns, "only these campaigns (default: any); may be repeated")
      ->allow_extra_args(false);
  issue->add_option("--run", arguments->runs, "only these runs (default: any); may be repeated")
      ->allow_extra_args(false);
  issue->add_option("--domain", arguments->domains, "only these DDS domains (default: any); may be repeated")
      ->check(CLI::Range(0, 230))
      ->allow_extra_args(false);
  issue->add_option("--days", arguments->days, "until it expires")
      ->check(CLI::Range(0.001, 3650.0))
      ->capture_default_str();
  issue->callback([=, &body] { body = [=] { return IssueIdentity(*arguments); }; });
}

}  // namespace

void AddSecurity(CLI::App& app, Body& body) {
  auto* command = AddGroup(app, "security", "who may do what on the bus: authority, identities, signing keys");
  auto initial = std::make_shared<InitArguments>();
  auto* init = command->add_subcommand("init", "make an authority: keys, certificates, rules of the domain");
  init->add_option("dir", initial->folder, "folder to make it in")->required();
  init->add_option("--protect", initial->protect, "encrypt | sign: payloads readable on the wire, twice as fast")
      ->check(CLI::IsMember({"encrypt", "sign"}))
      ->capture_default_str();
  init->callback([=, &body] { body = [=] { return Init(*initial); }; });
  AddIssue(*command, body);

  auto folder = std::make_shared<std::string>(), name = std::make_shared<std::string>();
  auto* revoke = command->add_subcommand("revoke", "take an identity back");
  revoke->add_option("dir", *folder, "folder of the authority")->required();
  revoke->add_option("name", *name, "the identity")->required();
  revoke->callback([=, &body] { body = [=] { return RevokeIdentity(*folder, *name); }; });

  auto* show = command->add_subcommand("show", "identities, their roles and days left");
  show->add_option("dir", *folder, "folder of the authority")->required();
  auto as_json = std::make_shared<bool>(false);
  show->add_flag("--json", *as_json, "as JSON");
  show->callback([=, &body] { body = [=] { return ShowAuthority(*folder, *as_json); }; });

  auto* key =
      command->add_subcommand("signing-key", "make a key that checkpoints are signed with, and its public half");
  key->add_option("file", *name, "the key's file; the public one is FILE.pub")->required();
  key->callback([=, &body] { body = [=] { return MakeKey(*name); }; });
}

}  // namespace etude::cli
