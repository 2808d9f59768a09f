// SPDX-License-Identifier: Apache-2.0
#include "services/security/certificate.h"

#include <fmt/format.h>
#include <openssl/ec.h>
#include <openssl/err.h>

#include <algorithm>
#include <cstring>
#include <ctime>

namespace etude::security {

Error OpensslError(Code code, std::string_view attempted) {
  char reason[256] = "unknown";
  if (const auto number = ERR_peek_last_error(); number != 0) ERR_error_string_n(number, reason, sizeof reason);
  ERR_clear_error();
  return {code, fmt::format("{}: {}", attempted, reason)};
}

Bio MemoryBio(std::string_view text) { return Bio(BIO_new_mem_buf(text.data(), static_cast<int>(text.size()))); }
Bio EmptyBio() { return Bio(BIO_new(BIO_s_mem())); }

std::string TextOf(const Bio& bio) {
  char* data = nullptr;
  const long size = BIO_get_mem_data(bio.get(), &data);
  return size > 0 ? std::string(data, static_cast<std::size_t>(size)) : std::string();
}

namespace {

constexpr std::uint64_t kMostPem = 1 << 20;

template <class Owner, class Read>
Result<Owner> ReadPem(const Path& file, const char* what, const Read& read) {
  ETUDE_ASSIGN_OR_RETURN(const std::string text, ReadTextFile(file, kMostPem));
  Owner object(read(MemoryBio(text).get()));
  if (!object) return Fail(OpensslError(Code::kCorrupt, fmt::format("read {} '{}'", what, file.string())));
  return object;
}

template <class Write>
Result<std::string> ToPem(const Write& write) {
  const Bio bio = EmptyBio();
  if (write(bio.get()) != 1) return Fail(OpensslError(Code::kInternal, "write PEM"));
  return TextOf(bio);
}

}  // namespace

Result<Certificate> ReadCertificate(const Path& file) {
  return ReadPem<Certificate>(file, "certificate",
                              [](BIO* bio) { return PEM_read_bio_X509(bio, nullptr, nullptr, nullptr); });
}

Result<Crl> ReadCrl(const Path& file) {
  return ReadPem<Crl>(file, "revocation list",
                      [](BIO* bio) { return PEM_read_bio_X509_CRL(bio, nullptr, nullptr, nullptr); });
}

Result<Key> ReadPrivateKey(const Path& file) {
  return ReadPem<Key>(file, "private key",
                      [](BIO* bio) { return PEM_read_bio_PrivateKey(bio, nullptr, nullptr, nullptr); });
}

Result<Key> MakeEcKey() {
  Key key(EVP_EC_gen("P-256"));
  if (!key) return Fail(OpensslError(Code::kInternal, "make a key (EC P-256)"));
  return key;
}

Result<std::string> PemOf(const Key& key) {
  return ToPem(
      [&](BIO* bio) { return PEM_write_bio_PKCS8PrivateKey(bio, key.get(), nullptr, nullptr, 0, nullptr, nullptr); });
}

Result<std::string> PemOf(const Certificate& certificate) {
  return ToPem([&](BIO* bio) { return PEM_write_bio_X509(bio, certificate.get()); });
}

Result<std::string> PemOf(const Crl& crl) {
  return ToPem([&](BIO* bio) { return PEM_write_bio_X509_CRL(bio, crl.get()); });
}

std::int64_t SecondsOf(const ASN1_TIME* time) {
  std::tm utc{};
  if (ASN1_TIME_to_tm(time, &utc) != 1) return 0;
  return ::timegm(&utc);
}

std::string SerialOf(const X509* certificate) {
  BIGNUM* const number = ASN1_INTEGER_to_BN(X509_get0_serialNumber(certificate), nullptr);
  char* const digits = BN_bn2hex(number);
  std::string text = digits == nullptr ? "" : digits;
  OPENSSL_free(digits);
  BN_free(number);
  return text;
}

std::string SubjectOf(const X509* certificate) {
  const Bio bio = EmptyBio();
  X509_NAME_print_ex(bio.get(), X509_get_subject_name(certificate), 0, XN_FLAG_RFC2253);
  return TextOf(bio);
}

namespace {

std::string Attribute(const X509* certificate, int nid) {
  char text[256] = {};
  const int size = X509_NAME_get_text_by_NID(X509_get_subject_name(certificate), nid, text, sizeof text);
  return size > 0 ? std::string(text, static_cast<std::size_t>(size)) : std::string();
}

}  // namespace

Result<Identity> IdentityOf(const X509* certificate, const std::string& what) {
  Identity identity;
  identity.name = Attribute(certificate, NID_commonName);
  identity.subject = SubjectOf(certificate);
  identity.serial = SerialOf(certificate);
  identity.not_before = SecondsOf(X509_get0_notBefore(certificate));
  identity.not_after = SecondsOf(X509_get0_notAfter(certificate));
  std::string roles = Attribute(certificate, NID_organizationalUnitName);
  for (std::size_t begin = 0; begin <= roles.size();) {
    const std::size_t end = std::min(roles.find('.', begin), roles.size());
    auto role = ParseRole(roles.substr(begin, end - begin));
    if (!role)
      return Fail(Code::kCorrupt, fmt::format("{} of '{}' is none of `etude security issue`: {}", what,
                                              identity.subject, role.error().message));
    identity.roles.push_back(*role);
    begin = end + 1;
  }
  return identity;
}

}  // namespace etude::security
