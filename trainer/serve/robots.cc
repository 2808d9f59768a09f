// SPDX-License-Identifier: Apache-2.0
#include "trainer/serve/robots.h"

#include <fmt/format.h>

#include <utility>

#include "services/core/file.h"
#include "services/core/log.h"

namespace etude::serve {
namespace {

constexpr char kAuthority[] = "identity-ca.pem";

// An identity of the one authority is good for whatever domain its permissions name, and who alters the library does
// not ask them.
Status CheckAuthorities(const std::string& of_robots, const std::string& of_run) {
  ETUDE_ASSIGN_OR_RETURN(const std::string robots, ReadTextFile(Path(of_robots) / kAuthority));
  ETUDE_ASSIGN_OR_RETURN(const std::string run, ReadTextFile(Path(of_run) / kAuthority));
  if (robots != run) return {};
  return Fail(
      Code::kInvalidArgument,
      fmt::format("identities '{}' and '{}' are of one authority: a worker's host that is stolen could speak to "
                  "robots; make them one of their own (etude security init)",
                  of_robots, of_run));
}

}  // namespace

Status CheckRobotDomain(const RobotDomain& robots, const RunDomain& run) {
  if (!robots.domain) {
    if (robots.profile.empty() && robots.security.empty()) return {};
    return Fail(Code::kInvalidArgument, "--robot-profile and --robot-security are of --robot-domain N: give it, too");
  }
  if (*robots.domain == run.domain)
    return Fail(Code::kInvalidArgument,
                fmt::format("--robot-domain {}: it is the run's own; give robots another one", run.domain));
  if (robots.security.empty() && !run.security.empty())
    return Fail(Code::kInvalidArgument,
                fmt::format("--security '{}' without --robot-security: anybody could speak to the robots in DDS domain "
                            "{}; make them an authority of their own (etude security init)",
                            run.security, *robots.domain));
  if (!robots.security.empty() && !run.security.empty())
    ETUDE_RETURN_IF_ERROR(CheckAuthorities(robots.security, run.security));
  if (!robots.security.empty() && run.security.empty() && !run.verifies)
    Log().warn("anybody in DDS domain {} can publish checkpoints that drive the robots: --verify or --security",
               run.domain);
  return {};
}

Result<std::optional<bus::Participant>> JoinRobotDomain(const RobotDomain& robots, const std::string& profile) {
  if (!robots.domain) return std::optional<bus::Participant>();
  ETUDE_ASSIGN_OR_RETURN(auto participant, bus::Participant::Open({*robots.domain,
                                                                   robots.profile.empty() ? profile : robots.profile,
                                                                   robots.security,
                                                                   {security::Role::kPolicy}}));
  Log().info("robots are answered in DDS domain {}", *robots.domain);
  return std::optional<bus::Participant>(std::move(participant));
}

}  // namespace etude::serve
