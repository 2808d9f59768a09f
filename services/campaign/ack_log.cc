// SPDX-License-Identifier: Apache-2.0
#include "services/campaign/ack_log.h"

#include <fmt/format.h>

#include <cstdlib>
#include <utility>

#include "services/core/check.h"
#include "services/core/hash.h"

namespace etude::campaign {
namespace {

const char* NameOf(bus::AckKind kind) {
  if (kind == bus::AckKind::kDone) return "done";
  return kind == bus::AckKind::kDuplicate ? "duplicate" : "refused";
}

}  // namespace

AckLog AckLog::FromEnvironment() {
  AckLog log;
  const char* path = std::getenv("ETUDE_ACK_LOG");
  if (path == nullptr) return log;
  auto opened = LineAppender::Open(path);
  ETUDE_CHECK(opened.has_value(), "ETUDE_ACK_LOG: {}", opened.error().message);
  log.file_.emplace(std::move(*opened));
  return log;
}

void AckLog::Note(const std::string& campaign_id, const bus::Lease& lease, const bus::Verdict& verdict,
                  std::span<const std::uint8_t> bytes) {
  if (!file_) return;
  const Status noted = file_->Append(fmt::format("{} {} {} {} {} {}", campaign_id, lease.index, lease.attempt,
                                                 lease.token, NameOf(verdict.kind), Sha256Hex(bytes)));
  ETUDE_CHECK(noted.has_value(), "ETUDE_ACK_LOG: {}", noted.error().message);
  const Status synced = file_->Sync();
  ETUDE_CHECK(synced.has_value(), "ETUDE_ACK_LOG: {}", synced.error().message);
}

}  // namespace etude::campaign
