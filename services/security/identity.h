// SPDX-License-Identifier: Apache-2.0
// The identity that a process has on a secured bus: a folder made by `etude security issue`.
//
//   cert.pem  key.pem  permissions.p7s                                 its own
//   identity-ca.pem  permissions-ca.pem  governance.p7s  crl.pem       the same for all of a fleet
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "services/core/file.h"
#include "services/core/result.h"
#include "services/security/role.h"

namespace etude::security {

struct Identity {
  Path folder;          ///< absolute
  std::string name;     ///< the certificate's common name
  std::string subject;  ///< RFC 2253: "CN=NAME,OU=ROLE.ROLE,O=Etude"
  std::vector<Role> roles;
  std::int64_t not_before = 0, not_after = 0;  ///< seconds since 1970
  std::string serial;                          ///< hexadecimal

  bool Has(Role role) const;
};

/// Reads the certificate alone.
/// @error kNotFound, kCorrupt: it is none of ours.
Result<Identity> ReadIdentityCertificate(const Path& file);

/// Reads a folder and checks what would else end in a silent bus: that all files are there and belong together, that
/// nobody else may read the key, that the dates hold now, that it is not revoked, and that it has `roles`.
/// @error kUnavailable: says which of them, and what to do.
Result<Identity> OpenIdentity(const Path& folder, const std::vector<Role>& roles);

/// The folder of the identity that a child in `role` gets from a process with the identity `folder`: the same when it
/// has the role, else its neighbour of the role's name.
Path IdentityFor(const Path& folder, Role role);

/// When it must be said that an identity expires (80 % of its life), and when its process must end: before the library
/// ends the participant without a word. Seconds since 1970.
std::int64_t WarnAt(const Identity& identity);
std::int64_t EndAt(const Identity& identity);
/// The two commands that give its holder another one, which holds for longer; the first takes this one back.
std::string HowToRenew(const Identity& identity);

/// "2026-01-31 12:00:00Z"
std::string UtcText(std::int64_t seconds);

}  // namespace etude::security
