// SPDX-License-Identifier: Apache-2.0
// The authority of a secured bus: two certificate authorities (one for identities, one for permissions), what it
// issued, and what it took back. A folder:
//
//   ca/      identity-ca.key permissions-ca.key (mode 0600; meant to be kept off the hosts), issued.json
//   public/  identity-ca.pem permissions-ca.pem governance.p7s crl.pem
//   NAME/    an identity (services/security/identity.h)
//
// Keys are EC P-256: of the types that Cyclone DDS takes the fastest. Not thread-safe; one process at a time.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "services/core/file.h"
#include "services/core/result.h"
#include "services/security/role.h"

namespace etude::security {

/// What goes over the wire in clear.
enum class Protection : std::uint8_t {
  kEncrypt,  ///< nothing but addresses, certificates and permissions
  kSign,     ///< payloads; about twice as fast
};

struct IssueOptions {
  std::string name;  ///< [a-z0-9-]{1,48}, once in an authority
  std::vector<Role> roles;
  std::vector<std::string> campaigns, runs;    ///< for `show`; empty: any
  std::vector<Grant> grants;                   ///< what roles, campaigns and runs come to
  std::vector<std::uint32_t> domains;          ///< DDS domains; empty: all
  std::int64_t not_before = 0, not_after = 0;  ///< seconds since 1970
};

struct Issued {
  std::string name, serial;
  std::vector<std::string> roles, campaigns, runs;
  std::int64_t not_before = 0, not_after = 0;
  std::vector<std::uint32_t> domains;   ///< empty: all
  std::optional<std::int64_t> revoked;  ///< when
};

/// @error kInvalidArgument: `folder` holds an authority already
Status InitAuthority(const Path& folder, Protection protection);

/// Makes FOLDER/NAME; in place of an expired or revoked one of that name, else the name must be new. Returns it.
/// @error kInvalidArgument: the name, no role, the dates; kNotFound: no authority
Result<Path> Issue(const Path& folder, const IssueOptions& options);

/// Takes back every certificate of `name`, and puts the new public/crl.pem into all identities of this folder.
/// @error kNotFound: never issued
Status Revoke(const Path& folder, const std::string& name);

/// Everything that was issued, oldest first.
Result<std::vector<Issued>> ReadIssued(const Path& folder);

}  // namespace etude::security
