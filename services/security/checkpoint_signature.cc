// SPDX-License-Identifier: Apache-2.0
#include "services/security/checkpoint_signature.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <nlohmann/json.hpp>

#include "services/core/descriptor.h"
#include "services/core/hash.h"
#include "services/core/log.h"
#include "services/security/certificate.h"

namespace etude::security {
namespace {

using Json = nlohmann::ordered_json;

constexpr char kField[] = "signature";
constexpr std::size_t kSignatureSize = 64;
constexpr std::size_t kMaxMetadata = 1 << 20;  // bytes of JSON, which take many times that in memory

// What is signed. A line each, and no value can hold the end of one: none reads as another.
std::string Statement(const Published& published) {
  return fmt::format("etude checkpoint 1\nowner {}\nchannel {}\nversion {}\nsha256 {}\n", published.owner,
                     published.channel, published.version, published.sha256);
}

std::string Hex(const std::uint8_t* bytes, std::size_t size) {
  std::string text;
  for (std::size_t i = 0; i < size; ++i) text += fmt::format("{:02x}", bytes[i]);
  return text;
}

// Empty when `text` is no signature in hexadecimal digits.
std::vector<std::uint8_t> Unhex(const std::string& text) {
  if (text.size() != 2 * kSignatureSize) return {};
  std::vector<std::uint8_t> bytes(kSignatureSize);
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    const int digit = c >= '0' && c <= '9' ? c - '0' : c >= 'a' && c <= 'f' ? c - 'a' + 10 : -1;
    if (digit < 0) return {};
    bytes[i / 2] = static_cast<std::uint8_t>(bytes[i / 2] * 16 + digit);
  }
  return bytes;
}

Status CheckEd25519(const Key& key, const Path& file) {
  if (EVP_PKEY_get_base_id(key.get()) == EVP_PKEY_ED25519) return {};
  return Fail(Code::kCorrupt,
              fmt::format("'{}' is no Ed25519 key; make one with: etude security signing-key FILE", file.string()));
}

const std::uint8_t* Bytes(const std::string& text) { return reinterpret_cast<const std::uint8_t*>(text.data()); }

using Digest = std::unique_ptr<EVP_MD_CTX, FreeWith<EVP_MD_CTX_free>>;

// {"RUN_ID/CHANNEL": {"version": n, "sha256": "..."}}; empty where there is no file yet. One that is there and cannot
// be read is not the same as none: everything old would be let in again.
Result<Json> ReadFloor(const Path& file) {
  const auto text = ReadTextFile(file, 1 << 26);
  if (!text && text.error().code == Code::kNotFound) return Json::object();
  if (!text) return Fail(text.error().Wrap("the checkpoints' floor"));
  Json floor = Json::parse(*text, nullptr, false);
  const auto is_entry = [](const Json& entry) {
    return entry.is_object() && entry.contains("version") && entry["version"].is_number_unsigned() &&
           entry.contains("sha256") && entry["sha256"].is_string();
  };
  if (!floor.is_object() || !std::all_of(floor.begin(), floor.end(), is_entry))
    return Fail(Code::kCorrupt, fmt::format("the checkpoints' floor '{}' cannot be read; to begin anew, which lets "
                                            "older checkpoints in again, remove it",
                                            file.string()));
  return floor;
}

// Held while a floor is read and raised: subscribers of this host may share one. It is not the floor itself, which is
// another file after each change.
Result<Descriptor> LockFloor(const Path& floor) {
  ETUDE_RETURN_IF_ERROR(MakeFolders(floor.parent_path()));
  const Path path = floor.string() + ".lock";
  Descriptor lock(::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644));
  if (!lock) return Fail(ErrnoError("open", path, errno));
  while (::flock(lock.get(), LOCK_EX) != 0)
    if (errno != EINTR) return Fail(ErrnoError("lock", path, errno));
  return lock;
}

}  // namespace

Status MakeSigningKey(const Path& file) {
  const Key key(EVP_PKEY_Q_keygen(nullptr, nullptr, "ED25519"));
  if (!key) return Fail(OpensslError(Code::kInternal, "make a key (Ed25519)"));
  ETUDE_ASSIGN_OR_RETURN(const std::string text, PemOf(key));
  const Bio bio = EmptyBio();
  if (PEM_write_bio_PUBKEY(bio.get(), key.get()) != 1) return Fail(OpensslError(Code::kInternal, "write PEM"));
  const Path public_file = file.string() + ".pub";
  std::error_code error;
  if (std::filesystem::exists(public_file, error))
    return Fail(Code::kUnavailable, fmt::format("'{}' is there already; take another name", public_file.string()));
  if (file.has_parent_path()) ETUDE_RETURN_IF_ERROR(MakeFolders(file.parent_path()));
  ETUDE_RETURN_IF_ERROR(WriteSecret(file, text));
  return WriteFileAtomically(public_file, TextOf(bio));
}

// ---- CheckpointSigner -----------------------------------------------------------------------------

struct CheckpointSigner::Impl {
  Key key;
};

CheckpointSigner::CheckpointSigner(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
CheckpointSigner::CheckpointSigner(CheckpointSigner&&) noexcept = default;
CheckpointSigner& CheckpointSigner::operator=(CheckpointSigner&&) noexcept = default;
CheckpointSigner::~CheckpointSigner() = default;

Result<CheckpointSigner> CheckpointSigner::Open(const Path& file) {
  struct stat info {};
  if (::stat(file.c_str(), &info) != 0) return Fail(ErrnoError("read the signing key", file, errno));
  if ((info.st_mode & 077) != 0)
    return Fail(Code::kUnavailable,
                fmt::format("signing key '{}' has mode {:04o}, so others can read it; run: chmod 600 {}", file.string(),
                            info.st_mode & 07777, file.string()));
  ETUDE_ASSIGN_OR_RETURN(Key key, ReadPrivateKey(file));
  ETUDE_RETURN_IF_ERROR(CheckEd25519(key, file));
  return CheckpointSigner(std::unique_ptr<Impl>(new Impl{std::move(key)}));
}

Result<std::string> CheckpointSigner::Sign(const Published& published, const std::string& meta_json) const {
  Json metadata = Json::parse(meta_json, nullptr, false);
  if (!metadata.is_object()) return Fail(Code::kInvalidArgument, "sign a checkpoint: its metadata is no JSON object");
  const std::string statement = Statement(published);
  const Digest digest(EVP_MD_CTX_new());
  std::uint8_t signature[kSignatureSize];
  std::size_t size = sizeof signature;
  if (EVP_DigestSignInit(digest.get(), nullptr, nullptr, nullptr, impl_->key.get()) != 1 ||
      EVP_DigestSign(digest.get(), signature, &size, Bytes(statement), statement.size()) != 1)
    return Fail(OpensslError(Code::kInternal, "sign a checkpoint"));
  metadata[kField] = Hex(signature, size);
  return metadata.dump();
}

// ---- CheckpointVerifier ---------------------------------------------------------------------------

struct CheckpointVerifier::Impl {
  Key key;
  Path floor_file;

  Status CheckSignature(const Published& published, const std::string& meta_json) const;
};

CheckpointVerifier::CheckpointVerifier(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
CheckpointVerifier::CheckpointVerifier(CheckpointVerifier&&) noexcept = default;
CheckpointVerifier& CheckpointVerifier::operator=(CheckpointVerifier&&) noexcept = default;
CheckpointVerifier::~CheckpointVerifier() = default;

const Path& CheckpointVerifier::floor() const { return impl_->floor_file; }

Result<std::shared_ptr<CheckpointVerifier>> VerifyArguments::Open() const {
  if (key.empty()) {
    if (!floor.empty()) return Fail(Code::kInvalidArgument, "--floor needs --verify PUBLIC_KEY");
    return std::shared_ptr<CheckpointVerifier>();
  }
  ETUDE_ASSIGN_OR_RETURN(auto verifier, CheckpointVerifier::Open(key, floor));
  Log().info("checkpoints are taken only with a signature of key='{}'; the newest that was taken is kept in '{}'", key,
             verifier.floor().string());
  return std::make_shared<CheckpointVerifier>(std::move(verifier));
}

Result<Path> DefaultFloor(const Path& public_key) {
  ETUDE_ASSIGN_OR_RETURN(const std::string text, ReadTextFile(public_key, 1 << 20));
  const char* const state = std::getenv("XDG_STATE_HOME");
  const char* const home = std::getenv("HOME");
  if ((state == nullptr || *state == '\0') && (home == nullptr || *home == '\0'))
    return Fail(Code::kUnavailable, "where to keep the checkpoints' floor: HOME is not set; give --floor FILE");
  const Path folder = state != nullptr && *state != '\0' ? Path(state) : Path(home) / ".local" / "state";
  return folder / "etude" / fmt::format("checkpoint-floor-{:.12}.json", Sha256Hex(text));
}

Result<CheckpointVerifier> CheckpointVerifier::Open(const Path& public_key, const Path& floor) {
  ETUDE_ASSIGN_OR_RETURN(const std::string text, ReadTextFile(public_key, 1 << 20));
  Key key(PEM_read_bio_PUBKEY(MemoryBio(text).get(), nullptr, nullptr, nullptr));
  if (!key) return Fail(OpensslError(Code::kCorrupt, fmt::format("read the public key '{}'", public_key.string())));
  ETUDE_RETURN_IF_ERROR(CheckEd25519(key, public_key));
  auto impl = std::make_unique<Impl>(Impl{std::move(key), floor});
  if (floor.empty()) {
    ETUDE_ASSIGN_OR_RETURN(impl->floor_file, DefaultFloor(public_key));
  }
  // to say at the start what would refuse every checkpoint: one that is not there yet may be where nobody can write
  ETUDE_ASSIGN_OR_RETURN(const Descriptor lock, LockFloor(impl->floor_file));
  ETUDE_RETURN_IF_ERROR(ReadFloor(impl->floor_file));
  return CheckpointVerifier(std::move(impl));
}

Status CheckpointVerifier::Impl::CheckSignature(const Published& published, const std::string& meta_json) const {
  // nothing here is signed yet
  if (meta_json.size() > kMaxMetadata)
    return Fail(Code::kCorrupt, fmt::format("its metadata of {} bytes are no checkpoint's", meta_json.size()));
  const Json metadata = Json::parse(meta_json, nullptr, false);
  if (!metadata.is_object() || !metadata.contains(kField) || !metadata[kField].is_string())
    return Fail(Code::kCorrupt, "it is not signed; its trainer needs --sign KEY");
  const auto signature = Unhex(metadata[kField].get<std::string>());
  const std::string statement = Statement(published);
  const Digest digest(EVP_MD_CTX_new());
  if (signature.empty() || EVP_DigestVerifyInit(digest.get(), nullptr, nullptr, nullptr, key.get()) != 1 ||
      EVP_DigestVerify(digest.get(), signature.data(), signature.size(), Bytes(statement), statement.size()) != 1)
    return Fail(Code::kCorrupt, "its signature does not fit: it was altered, or signed with another key");
  return {};
}

Status CheckpointVerifier::Check(const Published& published, const std::string& meta_json) {
  ETUDE_RETURN_IF_ERROR(impl_->CheckSignature(published, meta_json));
  const std::string key = published.owner + "/" + published.channel;
  ETUDE_ASSIGN_OR_RETURN(const Descriptor lock, LockFloor(impl_->floor_file));
  auto read = ReadFloor(impl_->floor_file);
  // that says nothing of what is judged: it is judged again, and what a relay keeps stays
  if (!read) return Fail(Code::kUnavailable, read.error().message);
  Json floor = std::move(*read);
  if (floor.contains(key)) {
    const auto& kept = floor[key];
    const auto version = kept["version"].get<std::uint64_t>();
    const bool same = version == published.version && kept["sha256"] == published.sha256;
    if (same) return {};
    if (published.version <= version)
      return Fail(Code::kInvalidArgument,
                  fmt::format("version {} is not newer than {}, which was taken before (kept in '{}')",
                              published.version, version, impl_->floor_file.string()));
  }
  floor[key] = {{"version", published.version}, {"sha256", published.sha256}};
  return WriteFileAtomically(impl_->floor_file, floor.dump(1) + "\n");
}

}  // namespace etude::security
