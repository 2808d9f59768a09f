// SPDX-License-Identifier: Apache-2.0
// Owners of OpenSSL's objects, and the few things that authority and identity both do with them. Internal to
// services/security.
#pragma once

#include <openssl/bio.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/pkcs7.h>
#include <openssl/x509.h>
#include <openssl/x509v3.h>

#include <memory>
#include <string>
#include <string_view>

#include "services/core/file.h"
#include "services/core/result.h"
#include "services/security/identity.h"

namespace etude::security {

template <auto kFree>
struct FreeWith {
  template <class T>
  void operator()(T* object) const {
    kFree(object);
  }
};
using Bio = std::unique_ptr<BIO, FreeWith<BIO_free_all>>;
using Key = std::unique_ptr<EVP_PKEY, FreeWith<EVP_PKEY_free>>;
using Certificate = std::unique_ptr<X509, FreeWith<X509_free>>;
using Crl = std::unique_ptr<X509_CRL, FreeWith<X509_CRL_free>>;
using Pkcs7 = std::unique_ptr<PKCS7, FreeWith<PKCS7_free>>;

/// The library's last word on why it failed, with what was attempted.
Error OpensslError(Code code, std::string_view attempted);

Bio MemoryBio(std::string_view text);
Bio EmptyBio();
std::string TextOf(const Bio& bio);

Result<Certificate> ReadCertificate(const Path& file);
Result<Crl> ReadCrl(const Path& file);
Result<Key> ReadPrivateKey(const Path& file);
Result<Key> MakeEcKey();
Result<std::string> PemOf(const Key& key);
Result<std::string> PemOf(const Certificate& certificate);
Result<std::string> PemOf(const Crl& crl);

/// Seconds since 1970.
std::int64_t SecondsOf(const ASN1_TIME* time);
std::string SerialOf(const X509* certificate);
std::string SubjectOf(const X509* certificate);
Result<Identity> IdentityOf(const X509* certificate, const std::string& what);

}  // namespace etude::security
