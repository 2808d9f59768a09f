// SPDX-License-Identifier: Apache-2.0
#include "services/security/authority.h"

#include <fcntl.h>
#include <fmt/chrono.h>
#include <fmt/format.h>
#include <openssl/rand.h>
#include <openssl/x509v3.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <nlohmann/json.hpp>
#include <set>

#include "services/core/clock.h"
#include "services/core/descriptor.h"
#include "services/core/file_lock.h"
#include "services/core/stop.h"
#include "services/security/certificate.h"

namespace etude::security {
namespace {

constexpr std::int64_t kDay = 86400;
constexpr int kAuthorityDays = 3650;
constexpr const char* kPublicFiles[] = {"identity-ca.pem", "permissions-ca.pem", "governance.p7s", "crl.pem"};

std::int64_t Now() { return static_cast<std::int64_t>(WallSeconds()); }

// ---- documents ------------------------------------------------------------------------------------

constexpr char kHead[] =
    "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n"
    "<dds xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\">\n";

std::string DomainsText(const std::vector<std::uint32_t>& domains) {
  if (domains.empty()) return "<domains><id_range><min>0</min><max>230</max></id_range></domains>";
  std::string text = "<domains>";
  for (const auto domain : domains) text += fmt::format("<id>{}</id>", domain);
  return text + "</domains>";
}

// Everything but the transport's own headers is protected by keys of the writer: one pass over the bytes.
std::string GovernanceText(Protection protection) {
  return fmt::format(
      "{}<domain_access_rules><domain_rule>\n{}\n"
      "<allow_unauthenticated_participants>false</allow_unauthenticated_participants>\n"
      "<enable_join_access_control>true</enable_join_access_control>\n"
      "<discovery_protection_kind>ENCRYPT</discovery_protection_kind>\n"
      "<liveliness_protection_kind>ENCRYPT</liveliness_protection_kind>\n"
      "<rtps_protection_kind>NONE</rtps_protection_kind>\n"
      "<topic_access_rules><topic_rule>\n<topic_expression>*</topic_expression>\n"
      "<enable_discovery_protection>true</enable_discovery_protection>\n"
      "<enable_liveliness_protection>true</enable_liveliness_protection>\n"
      "<enable_read_access_control>true</enable_read_access_control>\n"
      "<enable_write_access_control>true</enable_write_access_control>\n"
      "<metadata_protection_kind>{}</metadata_protection_kind>\n"
      "<data_protection_kind>NONE</data_protection_kind>\n"
      "</topic_rule></topic_access_rules>\n</domain_rule></domain_access_rules></dds>\n",
      kHead, DomainsText({}), protection == Protection::kSign ? "SIGN" : "ENCRYPT");
}

std::string DateText(std::int64_t seconds) {
  std::string text = UtcText(seconds);
  text[10] = 'T';
  return text;
}

// One rule for each direction, topic and partition: rules with several are not told apart by all versions.
std::string PermissionsText(const std::string& subject, const IssueOptions& options) {
  std::string rules;
  const std::string domains = DomainsText(options.domains);
  for (const auto& grant : options.grants) {
    const char* const direction = grant.publish ? "publish" : "subscribe";
    rules += fmt::format(
        "<allow_rule>{}<{}><topics><topic>{}</topic></topics><partitions><partition>{}</partition></partitions></{}>"
        "</allow_rule>\n",
        domains, direction, grant.topic, grant.partition, direction);
  }
  return fmt::format(
      "{}<permissions><grant name=\"{}\">\n<subject_name>{}</subject_name>\n"
      "<validity><not_before>{}</not_before><not_after>{}</not_after></validity>\n{}<default>DENY</default>\n"
      "</grant></permissions></dds>\n",
      kHead, options.name, subject, DateText(options.not_before), DateText(options.not_after), rules);
}

// S/MIME with the text in clear, as the standard asks for.
Result<std::string> SignDocument(const std::string& text, const Certificate& authority, const Key& key) {
  const Bio in = MemoryBio(text), out = EmptyBio();
  constexpr int kFlags = PKCS7_TEXT | PKCS7_DETACHED | PKCS7_STREAM;
  const Pkcs7 document(PKCS7_sign(authority.get(), key.get(), nullptr, in.get(), kFlags));
  if (!document || SMIME_write_PKCS7(out.get(), document.get(), in.get(), kFlags) != 1)
    return Fail(OpensslError(Code::kInternal, "sign a document"));
  return TextOf(out);
}

// ---- certificates ---------------------------------------------------------------------------------

Status AddExtension(X509* certificate, int nid, const char* value) {
  X509V3_CTX context;
  X509V3_set_ctx_nodb(&context);
  X509V3_set_ctx(&context, certificate, certificate, nullptr, nullptr, 0);
  const std::unique_ptr<X509_EXTENSION, FreeWith<X509_EXTENSION_free>> extension(
      X509V3_EXT_conf_nid(nullptr, &context, nid, value));
  if (!extension || X509_add_ext(certificate, extension.get(), -1) != 1)
    return Fail(OpensslError(Code::kInternal, fmt::format("add the extension '{}'", value)));
  return {};
}

// Of at most 64 bytes, as X.509 bounds the parts of a name.
Status AddName(X509_NAME* name, const char* field, const std::string& value) {
  if (X509_NAME_add_entry_by_txt(name, field, MBSTRING_UTF8, reinterpret_cast<const unsigned char*>(value.data()),
                                 static_cast<int>(value.size()), -1, 0) == 1)
    return {};
  return Fail(OpensslError(Code::kInvalidArgument, fmt::format("put {}='{}' into a certificate's name", field, value)));
}

struct Subject {
  std::string unit, name;  // no unit: an authority
};

// Signed by `key`, with the name of `authority` as its issuer's (none: its own).
Result<Certificate> MakeCertificate(const Subject& subject, const Key& own, const X509* authority, const Key& key,
                                    std::int64_t not_before, std::int64_t not_after) {
  Certificate certificate(X509_new());
  X509* const raw = certificate.get();
  std::uint8_t random[16];
  ETUDE_RETURN_IF_ERROR(RAND_bytes(random, sizeof random) == 1 ? Status()
                                                               : Fail(OpensslError(Code::kInternal, "random bytes")));
  random[0] = static_cast<std::uint8_t>((random[0] & 0x7f) | 0x40);  // positive, and of a fixed length
  BIGNUM* const serial = BN_bin2bn(random, sizeof random, nullptr);
  BN_to_ASN1_INTEGER(serial, X509_get_serialNumber(raw));
  BN_free(serial);
  X509_set_version(raw, X509_VERSION_3);
  ASN1_TIME_set(X509_getm_notBefore(raw), not_before);
  ASN1_TIME_set(X509_getm_notAfter(raw), not_after);
  X509_NAME* const name = X509_get_subject_name(raw);
  ETUDE_RETURN_IF_ERROR(AddName(name, "O", "Etude"));
  if (!subject.unit.empty()) ETUDE_RETURN_IF_ERROR(AddName(name, "OU", subject.unit));
  ETUDE_RETURN_IF_ERROR(AddName(name, "CN", subject.name));
  X509_set_issuer_name(raw, authority ? X509_get_subject_name(authority) : name);
  X509_set_pubkey(raw, own.get());
  const bool is_authority = authority == nullptr;
  ETUDE_RETURN_IF_ERROR(
      AddExtension(raw, NID_basic_constraints, is_authority ? "critical,CA:TRUE,pathlen:0" : "critical,CA:FALSE"));
  ETUDE_RETURN_IF_ERROR(AddExtension(
      raw, NID_key_usage,
      is_authority ? "critical,keyCertSign,cRLSign,digitalSignature" : "critical,digitalSignature,keyAgreement"));
  // an identity must not pass as a signer of permissions
  if (!is_authority) ETUDE_RETURN_IF_ERROR(AddExtension(raw, NID_ext_key_usage, "clientAuth,serverAuth"));
  if (X509_sign(raw, key.get(), EVP_sha256()) <= 0) return Fail(OpensslError(Code::kInternal, "sign a certificate"));
  return certificate;
}

Result<Crl> MakeCrl(const Certificate& authority, const Key& key, const std::vector<Issued>& issued) {
  Crl crl(X509_CRL_new());
  X509_CRL_set_version(crl.get(), X509_CRL_VERSION_2);
  X509_CRL_set_issuer_name(crl.get(), X509_get_subject_name(authority.get()));
  const std::unique_ptr<ASN1_TIME, FreeWith<ASN1_TIME_free>> last(ASN1_TIME_set(nullptr, Now() - 60));
  const std::unique_ptr<ASN1_TIME, FreeWith<ASN1_TIME_free>> next(
      ASN1_TIME_set(nullptr, Now() + std::int64_t{kAuthorityDays} * kDay));
  X509_CRL_set1_lastUpdate(crl.get(), last.get());
  X509_CRL_set1_nextUpdate(crl.get(), next.get());
  for (const auto& item : issued) {
    // one that has expired is refused for that; the list is what every process reads at its start
    if (!item.revoked || item.not_after < Now() - kDay) continue;
    BIGNUM* number = nullptr;
    BN_hex2bn(&number, item.serial.c_str());
    const std::unique_ptr<ASN1_INTEGER, FreeWith<ASN1_INTEGER_free>> serial(BN_to_ASN1_INTEGER(number, nullptr));
    BN_free(number);
    const std::unique_ptr<ASN1_TIME, FreeWith<ASN1_TIME_free>> when(ASN1_TIME_set(nullptr, *item.revoked));
    X509_REVOKED* const entry = X509_REVOKED_new();
    X509_REVOKED_set_serialNumber(entry, serial.get());
    X509_REVOKED_set_revocationDate(entry, when.get());
    X509_CRL_add0_revoked(crl.get(), entry);
  }
  X509_CRL_sort(crl.get());
  if (X509_CRL_sign(crl.get(), key.get(), EVP_sha256()) <= 0)
    return Fail(OpensslError(Code::kInternal, "sign the revocation list"));
  return crl;
}

// ---- what was issued ------------------------------------------------------------------------------

using Json = nlohmann::ordered_json;

Path IssuedFile(const Path& folder) { return folder / "ca" / "issued.json"; }

Status WriteIssued(const Path& folder, const std::vector<Issued>& issued) {
  Json list = Json::array();
  for (const auto& item : issued) {
    Json entry{{"name", item.name},
               {"serial", item.serial},
               {"roles", item.roles},
               {"campaigns", item.campaigns},
               {"runs", item.runs},
               {"not_before", item.not_before},
               {"not_after", item.not_after},
               {"domains", item.domains},
               {"revoked", item.revoked ? Json(*item.revoked) : Json()}};
    list.push_back(std::move(entry));
  }
  return WriteFileAtomically(IssuedFile(folder), list.dump(1) + "\n");
}

// One of the two authorities: its certificate in public/, its key in ca/.
struct Authority {
  Certificate certificate;
  Key key;
};

Error NoAuthority(const Path& folder, const Path& missing) {
  return {Code::kNotFound, fmt::format("'{}' is no authority: '{}' is missing; make one with: etude security init {}",
                                       folder.string(), missing.string(), folder.string())};
}

Result<Authority> OpenAuthority(const Path& folder, const std::string& name) {
  const Path key = folder / "ca" / (name + "-ca.key");
  std::error_code error;
  if (!std::filesystem::exists(key, error)) return Fail(NoAuthority(folder, key));
  Authority authority;
  ETUDE_ASSIGN_OR_RETURN(authority.certificate, ReadCertificate(folder / "public" / (name + "-ca.pem")));
  ETUDE_ASSIGN_OR_RETURN(authority.key, ReadPrivateKey(key));
  return authority;
}

Result<Authority> MakeAuthority(const Path& folder, const std::string& name) {
  Authority authority;
  ETUDE_ASSIGN_OR_RETURN(authority.key, MakeEcKey());
  ETUDE_ASSIGN_OR_RETURN(authority.certificate,
                         MakeCertificate({"", name + " CA"}, authority.key, nullptr, authority.key, Now() - 60,
                                         Now() + std::int64_t{kAuthorityDays} * kDay));
  ETUDE_ASSIGN_OR_RETURN(const std::string key, PemOf(authority.key));
  ETUDE_ASSIGN_OR_RETURN(const std::string certificate, PemOf(authority.certificate));
  ETUDE_RETURN_IF_ERROR(WriteSecret(folder / "ca" / (name + "-ca.key"), key));
  ETUDE_RETURN_IF_ERROR(WriteFileAtomically(folder / "public" / (name + "-ca.pem"), certificate));
  return authority;
}

Status WriteCrl(const Path& folder, const Authority& authority, const std::vector<Issued>& issued) {
  ETUDE_ASSIGN_OR_RETURN(const Crl crl, MakeCrl(authority.certificate, authority.key, issued));
  ETUDE_ASSIGN_OR_RETURN(const std::string text, PemOf(crl));
  return WriteFileAtomically(folder / "public" / "crl.pem", text);
}

Status CopyPublic(const Path& folder, const Path& identity) {
  for (const char* name : kPublicFiles) {
    ETUDE_ASSIGN_OR_RETURN(const std::string text, ReadTextFile(folder / "public" / name, 1 << 20));
    ETUDE_RETURN_IF_ERROR(WriteFileAtomically(identity / name, text));
  }
  return {};
}

// Commas and slashes split a subject in the library, and a name is a folder.
Status CheckOptions(const IssueOptions& options) {
  const bool plain =
      !options.name.empty() && options.name.size() <= 48 && std::ranges::all_of(options.name, [](unsigned char c) {
        return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-';
      });
  // HOST--PROCESS is an address of a process (services/bus/owner.h)
  if (!plain || options.name == "ca" || options.name == "public" || options.name.find("--") != std::string::npos)
    return Fail(
        Code::kInvalidArgument,
        fmt::format("--name '{}': expected 1 to 48 of a-z 0-9 -, without --, not 'ca' or 'public'", options.name));
  if (options.roles.empty()) return Fail(Code::kInvalidArgument, "give at least one --role");
  for (const auto* names : {&options.campaigns, &options.runs})
    for (const auto& name : *names)
      if (!IsPlainName(name))
        return Fail(Code::kInvalidArgument, fmt::format("campaign or run '{}': must match [a-z0-9_-]{{1,64}}", name));
  if (options.not_after <= options.not_before)
    return Fail(Code::kInvalidArgument, fmt::format("'{}' would end ({}) before it begins ({})", options.name,
                                                    UtcText(options.not_after), UtcText(options.not_before)));
  return {};
}

// The files of an identity, but for those of the authority.
struct IdentityFiles {
  std::string serial, key, certificate, permissions;
};

Result<IdentityFiles> MakeIdentity(const Path& folder, const IssueOptions& options) {
  ETUDE_ASSIGN_OR_RETURN(const Authority identities, OpenAuthority(folder, "identity"));
  ETUDE_ASSIGN_OR_RETURN(const Authority permissions, OpenAuthority(folder, "permissions"));
  std::string unit;
  for (const Role role : options.roles) unit += (unit.empty() ? "" : ".") + ToString(role);
  ETUDE_ASSIGN_OR_RETURN(const Key key, MakeEcKey());
  ETUDE_ASSIGN_OR_RETURN(const Certificate certificate,
                         MakeCertificate({unit, options.name}, key, identities.certificate.get(), identities.key,
                                         options.not_before, options.not_after));
  IdentityFiles files;
  files.serial = SerialOf(certificate.get());
  ETUDE_ASSIGN_OR_RETURN(files.key, PemOf(key));
  ETUDE_ASSIGN_OR_RETURN(files.certificate, PemOf(certificate));
  ETUDE_ASSIGN_OR_RETURN(files.permissions, SignDocument(PermissionsText(SubjectOf(certificate.get()), options),
                                                         permissions.certificate, permissions.key));
  return files;
}

Status WriteIdentity(const Path& identity, const IdentityFiles& files) {
  std::error_code error;
  std::filesystem::remove(identity / "key.pem", error);
  ETUDE_RETURN_IF_ERROR(WriteSecret(identity / "key.pem", files.key));
  ETUDE_RETURN_IF_ERROR(WriteFileAtomically(identity / "cert.pem", files.certificate));
  return WriteFileAtomically(identity / "permissions.p7s", files.permissions);
}

}  // namespace

Status InitAuthority(const Path& folder, Protection protection) {
  std::error_code error;
  for (const char* name : {"ca", "public"})
    if (std::filesystem::exists(folder / name, error))
      return Fail(
          Code::kInvalidArgument,
          std::filesystem::exists(IssuedFile(folder), error)
              ? fmt::format("'{}' holds an authority already; a second one would shut out all identities of the first",
                            folder.string())
              : fmt::format(
                    "'{}' holds '{}' of an authority that was not made to its end, or of something else; remove "
                    "'ca' and 'public' in it, and begin again",
                    folder.string(), name));
  ETUDE_RETURN_IF_ERROR(MakeFolders(folder / "ca"));
  ETUDE_RETURN_IF_ERROR(MakeFolders(folder / "public"));
  std::filesystem::permissions(folder / "ca", std::filesystem::perms::owner_all, error);
  ETUDE_ASSIGN_OR_RETURN(const Authority identities, MakeAuthority(folder, "identity"));
  ETUDE_ASSIGN_OR_RETURN(const Authority permissions, MakeAuthority(folder, "permissions"));
  ETUDE_ASSIGN_OR_RETURN(const std::string governance,
                         SignDocument(GovernanceText(protection), permissions.certificate, permissions.key));
  ETUDE_RETURN_IF_ERROR(WriteFileAtomically(folder / "public" / "governance.p7s", governance));
  ETUDE_RETURN_IF_ERROR(WriteCrl(folder, identities, {}));
  return WriteIssued(folder, {});
}

namespace {

// Of several that issue and revoke side by side each sees what the one before has listed.
Result<FileLock> AwaitTurn(const Path& folder) {
  if (const auto there = ReadIssued(folder); !there) {
    if (there.error().code != Code::kNotFound) return Fail(there.error());
    return Fail(NoAuthority(folder, IssuedFile(folder)));
  }
  // a folder that cannot be written is no authority that another one uses: it is not waited for
  if (const Descriptor writable(::open((folder / "ca" / ".lock").c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644));
      !writable)
    return Fail(ErrnoError("open", folder / "ca" / ".lock", errno));
  constexpr int kTries = 300;
  for (int i = 0;; ++i) {
    auto lock = FileLock::Take(folder / "ca" / ".lock", fmt::format("authority '{}' is being used", folder.string()));
    if (lock || lock.error().code != Code::kUnavailable || i == kTries) return lock;
    if (WaitForStop(std::chrono::milliseconds(100))) return lock;
  }
}

}  // namespace

Result<Path> Issue(const Path& folder, const IssueOptions& asked) {
  IssueOptions options = asked;  // a role that is given twice counts once
  std::erase_if(options.roles, [seen = std::set<Role>()](Role role) mutable { return !seen.insert(role).second; });
  ETUDE_RETURN_IF_ERROR(CheckOptions(options));
  ETUDE_ASSIGN_OR_RETURN(const FileLock turn, AwaitTurn(folder));
  ETUDE_ASSIGN_OR_RETURN(auto issued, ReadIssued(folder));
  for (const auto& other : issued)
    if (other.name == options.name && !other.revoked && other.not_after > Now())
      return Fail(Code::kInvalidArgument,
                  fmt::format("'{}' was issued already and holds until {}; revoke it first, or take another --name",
                              options.name, UtcText(other.not_after)));
  const Path identity = folder / options.name;
  ETUDE_ASSIGN_OR_RETURN(const IdentityFiles files, MakeIdentity(folder, options));
  Issued entry{options.name,      files.serial,    {}, options.campaigns, options.runs, options.not_before,
               options.not_after, options.domains, {}};
  for (const Role role : options.roles) entry.roles.push_back(ToString(role));
  issued.push_back(std::move(entry));
  // first of all: what is not listed could not be revoked
  ETUDE_RETURN_IF_ERROR(WriteIssued(folder, issued));
  ETUDE_RETURN_IF_ERROR(MakeFolders(identity));
  ETUDE_RETURN_IF_ERROR(WriteIdentity(identity, files));
  ETUDE_RETURN_IF_ERROR(CopyPublic(folder, identity));
  return identity;
}

Status Revoke(const Path& folder, const std::string& name) {
  ETUDE_ASSIGN_OR_RETURN(const FileLock turn, AwaitTurn(folder));
  ETUDE_ASSIGN_OR_RETURN(auto issued, ReadIssued(folder));
  bool found = false;
  for (auto& item : issued) {
    if (item.name != name) continue;
    found = true;
    if (!item.revoked) item.revoked = Now();
  }
  if (!found)
    return Fail(Code::kNotFound, fmt::format("'{}' has issued no '{}'; see: etude security show {}", folder.string(),
                                             name, folder.string()));
  ETUDE_ASSIGN_OR_RETURN(const Authority identities, OpenAuthority(folder, "identity"));
  // the list first: the next revocation makes its CRL of it, and what only the CRL knew would be valid again
  ETUDE_RETURN_IF_ERROR(WriteIssued(folder, issued));
  ETUDE_RETURN_IF_ERROR(WriteCrl(folder, identities, issued));
  ETUDE_ASSIGN_OR_RETURN(const std::string crl, ReadTextFile(folder / "public" / "crl.pem", 1 << 24));
  std::error_code error;
  Status copied;  // why the first that could not be written was not: the others have it all the same
  for (const auto& item : issued) {
    if (!std::filesystem::is_directory(folder / item.name, error)) continue;
    const Status written = WriteFileAtomically(folder / item.name / "crl.pem", crl);
    if (!written && copied)
      copied =
          Fail(written.error().Wrap(fmt::format("'{}' is revoked, but not all identities here have the list; copy "
                                                "'{}' into the others",
                                                name, (folder / "public" / "crl.pem").string())));
  }
  return copied;
}

Result<std::vector<Issued>> ReadIssued(const Path& folder) {
  ETUDE_ASSIGN_OR_RETURN(const std::string text, ReadTextFile(IssuedFile(folder), 1 << 26));
  std::vector<Issued> issued;
  try {
    for (const auto& entry : Json::parse(text)) {
      Issued item;
      entry.at("name").get_to(item.name);
      entry.at("serial").get_to(item.serial);
      entry.at("roles").get_to(item.roles);
      entry.at("campaigns").get_to(item.campaigns);
      entry.at("runs").get_to(item.runs);
      entry.at("not_before").get_to(item.not_before);
      entry.at("not_after").get_to(item.not_after);
      item.domains = entry.value("domains", std::vector<std::uint32_t>());  // older lists have none
      if (const auto& revoked = entry.at("revoked"); revoked.is_number()) item.revoked = revoked.get<std::int64_t>();
      issued.push_back(std::move(item));
    }
  } catch (const nlohmann::json::exception& problem) {
    return Fail(Code::kCorrupt, fmt::format("read '{}': {}", IssuedFile(folder).string(), problem.what()));
  }
  return issued;
}

}  // namespace etude::security
