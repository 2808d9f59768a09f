// SPDX-License-Identifier: Apache-2.0
#include "services/security/identity.h"

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <ctime>

#include "services/core/clock.h"
#include "services/security/certificate.h"

namespace etude::security {
namespace {

constexpr const char* kFiles[] = {"cert.pem",           "key.pem",        "permissions.p7s", "identity-ca.pem",
                                  "permissions-ca.pem", "governance.p7s", "crl.pem"};

Status Refuse(const Path& folder, const std::string& why) {
  return Fail(Code::kUnavailable, fmt::format("identity '{}': {}", folder.string(), why));
}

Status CheckFiles(const Path& folder) {
  std::error_code error;
  if (!std::filesystem::is_directory(folder, error))
    return Refuse(folder, "no such folder; make one with: etude security issue DIR --role ROLE --name NAME");
  for (const char* name : kFiles)
    if (!std::filesystem::is_regular_file(folder / name, error))
      return Refuse(folder,
                    fmt::format("'{}' is missing; copy the whole folder that `etude security issue` made", name));
  struct stat info {};
  const Path key = folder / "key.pem";
  if (::stat(key.c_str(), &info) != 0) return Fail(ErrnoError("look at", key, errno));
  if ((info.st_mode & 077) != 0)
    return Refuse(folder, fmt::format("key.pem has mode {:04o}, so others can read it; run: chmod 600 {}",
                                      info.st_mode & 07777, key.string()));
  return {};
}

Status CheckDates(const Identity& identity) {
  const auto now = static_cast<std::int64_t>(WallSeconds());
  if (now < identity.not_before)
    return Refuse(identity.folder, fmt::format("it holds from {} on, and it is {}: is this machine's clock right?",
                                               UtcText(identity.not_before), UtcText(now)));
  if (now >= EndAt(identity))
    return Refuse(identity.folder, fmt::format("it {} {}; issue another one: {}",
                                               now >= identity.not_after ? "expired on" : "is about to expire on",
                                               UtcText(identity.not_after), HowToRenew(identity)));
  return {};
}

Status CheckRoles(const Identity& identity, const std::vector<Role>& roles) {
  for (const Role role : roles)
    if (!identity.Has(role))
      return Refuse(identity.folder, fmt::format("its role is {}, and this process needs {}; issue one with: etude "
                                                 "security issue DIR --role {} --name NAME",
                                                 ListText(identity.roles), ListText(roles),
                                                 fmt::join(
                                                     [&] {
                                                       std::vector<std::string> names;
                                                       for (const Role needed : roles)
                                                         names.push_back(ToString(needed));
                                                       return names;
                                                     }(),
                                                     " --role ")));
  return {};
}

// That the parts belong together, and what the authority says of them today.
Status CheckChain(const Identity& identity, X509* certificate) {
  const Path& folder = identity.folder;
  ETUDE_ASSIGN_OR_RETURN(const Key key, ReadPrivateKey(folder / "key.pem"));
  if (X509_check_private_key(certificate, key.get()) != 1)
    return Refuse(folder, "key.pem is not the key of cert.pem; issue it again");
  ETUDE_ASSIGN_OR_RETURN(const Certificate ca, ReadCertificate(folder / "identity-ca.pem"));
  if (X509_verify(certificate, X509_get0_pubkey(ca.get())) != 1)
    return Refuse(folder, "cert.pem is not signed by identity-ca.pem: they are of two authorities; issue it again");
  ETUDE_ASSIGN_OR_RETURN(const Crl crl, ReadCrl(folder / "crl.pem"));
  if (X509_CRL_verify(crl.get(), X509_get0_pubkey(ca.get())) != 1)
    return Refuse(folder, "crl.pem is not of the authority of identity-ca.pem");
  const auto now = static_cast<std::int64_t>(WallSeconds());
  if (const std::int64_t from = SecondsOf(X509_CRL_get0_lastUpdate(crl.get())); now < from)
    return Refuse(folder,
                  fmt::format("crl.pem holds from {} on, and it is {}, so that every certificate would count as "
                              "invalid: is this machine's clock right?",
                              UtcText(from), UtcText(now)));
  if (SecondsOf(X509_CRL_get0_nextUpdate(crl.get())) <= now)
    return Refuse(folder, "crl.pem is out of date, so that every certificate would count as invalid; make a new one");
  X509_REVOKED* entry = nullptr;
  if (X509_CRL_get0_by_cert(crl.get(), &entry, certificate) == 1)
    return Refuse(folder, fmt::format("the certificate of '{}' is revoked", identity.name));
  return {};
}

// What a document says, where it is the one that its authority signed.
Result<std::string> CheckSigned(const Path& folder, const char* name, X509* authority) {
  ETUDE_ASSIGN_OR_RETURN(const std::string text, ReadTextFile(folder / name, 1 << 20));
  const Bio in = MemoryBio(text), out = EmptyBio();
  BIO* content = nullptr;
  const Pkcs7 document(SMIME_read_PKCS7(in.get(), &content));
  const Bio owned(content);
  const std::unique_ptr<X509_STORE, FreeWith<X509_STORE_free>> store(X509_STORE_new());
  X509_STORE_add_cert(store.get(), authority);
  // the dates are checked by themselves, with better words
  X509_STORE_set_flags(store.get(), X509_V_FLAG_NO_CHECK_TIME);
  X509_STORE_set_purpose(store.get(), X509_PURPOSE_ANY);
  const bool sound = document && content != nullptr &&
                     PKCS7_verify(document.get(), nullptr, store.get(), owned.get(), out.get(), 0) == 1;
  if (sound) return TextOf(out);
  const Error why =
      OpensslError(Code::kUnavailable, fmt::format("'{}' is not what permissions-ca.pem signed; copy it again", name));
  return Fail(Refuse(folder, why.message).error());
}

// The library ends a participant without a word when the term of its permissions is over, whatever its certificate
// says.
Status CheckTerm(const Identity& identity, const std::string& permissions) {
  std::string end = UtcText(identity.not_after);
  end[10] = 'T';
  const auto says = [&](const char* element, const std::string& value) {
    return permissions.find(fmt::format("<{0}>{1}</{0}>", element, value)) != std::string::npos;
  };
  if (says("subject_name", identity.subject) && says("not_after", end)) return {};
  return Refuse(identity.folder,
                "permissions.p7s is not of this cert.pem (another name, or another end); copy the whole folder again");
}

}  // namespace

bool Identity::Has(Role role) const { return std::ranges::find(roles, role) != roles.end(); }

Result<Identity> ReadIdentityCertificate(const Path& file) {
  ETUDE_ASSIGN_OR_RETURN(const Certificate certificate, ReadCertificate(file));
  ETUDE_ASSIGN_OR_RETURN(Identity identity, IdentityOf(certificate.get(), file.string()));
  identity.folder = std::filesystem::absolute(file).parent_path().lexically_normal();
  return identity;
}

Result<Identity> OpenIdentity(const Path& folder, const std::vector<Role>& roles) {
  ETUDE_RETURN_IF_ERROR(CheckFiles(folder));
  const Path whole = std::filesystem::absolute(folder).lexically_normal();
  ETUDE_ASSIGN_OR_RETURN(const Certificate certificate, ReadCertificate(whole / "cert.pem"));
  ETUDE_ASSIGN_OR_RETURN(Identity identity, IdentityOf(certificate.get(), "cert.pem"));
  identity.folder = whole;
  ETUDE_RETURN_IF_ERROR(CheckDates(identity));
  ETUDE_RETURN_IF_ERROR(CheckChain(identity, certificate.get()));
  ETUDE_ASSIGN_OR_RETURN(const Certificate authority, ReadCertificate(whole / "permissions-ca.pem"));
  ETUDE_RETURN_IF_ERROR(CheckSigned(whole, "governance.p7s", authority.get()));
  ETUDE_ASSIGN_OR_RETURN(const std::string permissions, CheckSigned(whole, "permissions.p7s", authority.get()));
  ETUDE_RETURN_IF_ERROR(CheckTerm(identity, permissions));
  ETUDE_RETURN_IF_ERROR(CheckRoles(identity, roles));
  return identity;
}

Path IdentityFor(const Path& folder, Role role) {
  const auto identity = ReadIdentityCertificate(folder / "cert.pem");
  if (!identity || identity->Has(role)) return folder;
  const Path neighbour = identity->folder.parent_path() / ToString(role);
  std::error_code error;
  return std::filesystem::is_directory(neighbour, error) ? neighbour : folder;
}

std::int64_t WarnAt(const Identity& identity) {
  return identity.not_before + (identity.not_after - identity.not_before) * 4 / 5;
}

std::string HowToRenew(const Identity& identity) {
  std::string roles;
  for (const Role role : identity.roles) roles += fmt::format(" --role {}", ToString(role));
  return fmt::format(
      "etude security revoke DIR {0}; etude security issue DIR{1} --name {0}, with the --campaign, --run "
      "and domains that it had: etude security show DIR",
      identity.name, roles);
}

std::int64_t EndAt(const Identity& identity) {
  // At least 2 s, which are four looks of the watch: the library may crash in a process that is there at the end. Peers
  // go by clocks of their own: who is there, or drains, when it is over by another's looks lost there.
  constexpr std::int64_t kLeast = 2, kMost = 300;
  return identity.not_after - std::clamp((identity.not_after - identity.not_before) / 20, kLeast, kMost);
}

std::string UtcText(std::int64_t seconds) {
  const auto time = static_cast<std::time_t>(seconds);
  std::tm utc{};
  if (::gmtime_r(&time, &utc) == nullptr) return "?";
  return fmt::format("{:%Y-%m-%d %H:%M:%S}Z", utc);
}

}  // namespace etude::security
