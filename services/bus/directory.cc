// SPDX-License-Identifier: Apache-2.0
#include "services/bus/directory.h"

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>
#include <ctime>
#include <functional>
#include <set>
#include <tuple>

#include "services/bus/access.h"
#include "services/bus/participant_state.h"
#include "services/bus/topic.h"
#include "services/core/clock.h"
#include "services/core/command.h"
#include "services/core/enum_name.h"
#include "services/core/log.h"
#include "services/core/printable.h"
#include "services/core/stop.h"

namespace etude::bus {
namespace {

using namespace std::chrono_literals;

// how long one that has just joined the domain looks for who else is there
constexpr auto kLookAround = 300ms;
constexpr std::size_t kMostOthers = 1000;  // that are remembered as said
// and under security at most until all that it sees have been authenticated
constexpr auto kMostAuthentication = 3s;

bool Fits(const Presence& presence, PresenceKind kind, const Selector& selector) {
  return presence.kind == kind && presence.name == selector.name && presence.id.starts_with(selector.id);
}

bool IsOlder(const Presence& a, const Presence& b) {
  return std::tie(a.since, a.instance) < std::tie(b.since, b.instance);
}

// Whether both would lease some episode.
bool LeaseTheSame(const Presence& a, const Presence& b) {
  const bool shards = a.shards > 1 && b.shards > 1 && a.kind == PresenceKind::kCampaign && b.kind == a.kind;
  if (!shards || a.name != b.name || a.spec_sha256 != b.spec_sha256) return false;
  return a.shards != b.shards || a.shard == b.shard;
}

std::string LocalTime(std::uint64_t seconds) {
  const auto time = static_cast<std::time_t>(seconds);
  std::tm local{};
  if (::localtime_r(&time, &local) == nullptr) return "?";
  return fmt::format("{:%Y-%m-%d %H:%M:%S}", local);
}

}  // namespace

std::string ToString(PresenceKind kind) {
  return std::string(EnumName(kind, {{PresenceKind::kCampaign, "campaign"},
                                     {PresenceKind::kRun, "run"},
                                     {PresenceKind::kPolicy, "policy server"},
                                     {PresenceKind::kRelay, "relay"}}));
}

std::string ListText(const std::vector<Presence>& presences) {
  std::string text;
  for (const auto& item : presences)
    text += "\n" + Printable(fmt::format("  {}@{}  {}host {}  user {}  {}  since {}", item.name, item.id,
                                         item.shards > 1 ? ShardText(item) + "  " : "", item.host, item.user,
                                         item.folder.empty() ? "-" : item.folder, LocalTime(item.since)));
  return text;
}

namespace {

std::string FolderKey(const std::string& folder) {
  struct stat info {};
  // a file that is replaced stays the same one for people
  if (folder.empty() || ::stat(folder.c_str(), &info) != 0 || !S_ISDIR(info.st_mode)) return "";
  return fmt::format("{:x}:{:x}", info.st_dev, info.st_ino);
}

}  // namespace

std::string ShardText(const Presence& presence) {
  return presence.shards > 1 ? fmt::format("shard {}/{}", presence.shard, presence.shards) : "";
}

bool AreShardsOfOneCampaign(const Presence& a, const Presence& b) {
  return a.kind == PresenceKind::kCampaign && b.kind == a.kind && a.shards > 1 && a.shards == b.shards &&
         a.name == b.name && a.spec_sha256 == b.spec_sha256;
}

Presence MakePresence(PresenceKind kind, const std::string& name, const std::string& id, const std::string& folder) {
  Presence presence;
  presence.kind = kind;
  presence.id = id;
  presence.instance = NewId();
  presence.name = name;
  presence.version = Version();
  presence.host = HostName();
  presence.user = UserName();
  presence.folder = folder.empty() ? "" : std::filesystem::absolute(folder).lexically_normal().string();
  presence.folder_key = FolderKey(presence.folder);
  presence.since = static_cast<std::uint64_t>(WallSeconds());
  return presence;
}

// ---- Directory ------------------------------------------------------------------------------------

struct Directory::Impl {
  Participant participant;
  Reader<Presence> reader;
  MonotonicClock::time_point opened = MonotonicClock::now();
  std::optional<MonotonicClock::time_point> settled = {};  // from then on those who were there first are known
  std::set<std::string> refused = {};                      // of another user: not what replaces what was followed

  bool Settled();
  std::vector<Presence> Await(std::chrono::nanoseconds timeout, const std::function<std::vector<Presence>()>& look);
};

bool Directory::Impl::Settled() {
  const auto now = MonotonicClock::now();
  if (!settled && !participant.secured()) settled = opened + kLookAround;
  // what they keep for late joiners comes after they are admitted
  if (!settled && now >= opened + kLookAround && (participant.AllAdmitted() || now >= opened + kMostAuthentication))
    settled = now + kLookAround;
  return settled && now >= *settled;
}

Directory::Directory(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Directory::Directory(Directory&&) noexcept = default;
Directory& Directory::operator=(Directory&&) noexcept = default;
Directory::~Directory() = default;

Result<Directory> Directory::Open(const Participant& participant) {
  ETUDE_ASSIGN_OR_RETURN(auto reader, Reader<Presence>::Open(participant, kDirectoryPartition));
  return Directory(std::unique_ptr<Impl>(new Impl{participant.Share(), std::move(reader)}));
}

void Directory::WaitForOthers() {
  while (!impl_->Settled())
    if (WaitForStop(20ms)) return;
}

std::vector<Presence> Directory::Live() {
  auto live = impl_->reader.Live();
  std::sort(live.begin(), live.end(), IsOlder);
  return live;
}

std::vector<Presence> Directory::Matching(PresenceKind kind, const Selector& selector) {
  std::vector<Presence> matching;
  for (auto& presence : Live()) {
    if (!Fits(presence, kind, selector)) continue;
    const auto same = std::find_if(matching.begin(), matching.end(), [&](const Presence& other) {
      return other.id == presence.id || (AreShardsOfOneCampaign(other, presence) && other.shard == presence.shard);
    });
    if (same == matching.end())
      matching.push_back(std::move(presence));
    else if (presence.epoch >= same->epoch)
      *same = std::move(presence);
  }
  return matching;
}

bool Directory::Replaced(PresenceKind kind, const Selector& selector, const std::string& id, const std::string& user) {
  const auto matching = Matching(kind, selector);
  if (std::ranges::find(matching, id, &Presence::id) != matching.end()) return false;
  for (const Presence& other : matching) {
    if (user.empty() || other.user == user) return true;
    if (impl_->refused.size() < kMostOthers && impl_->refused.insert(other.id).second)
      Log().warn("{} {}@{} is of user {} on {}, and {}@{} of user {}: it is not followed; give {}@{} to do so",
                 ToString(kind), other.name, other.id, other.user, other.host, selector.name, id, user, other.name,
                 other.id);
  }
  return false;
}

// What `look` finds, once there is something and those who were there first are known.
std::vector<Presence> Directory::Impl::Await(std::chrono::nanoseconds timeout,
                                             const std::function<std::vector<Presence>()>& look) {
  const auto deadline = MonotonicClock::now() + timeout;
  auto matching = look();
  while (!StopRequested() && (matching.empty() ? MonotonicClock::now() < deadline : !Settled())) {
    // presences are read, not taken: waiting for news would not wait
    const auto left = matching.empty() ? deadline - MonotonicClock::now() : MonotonicClock::duration(20ms);
    WaitForStop(std::clamp<std::chrono::nanoseconds>(left, 1ms, 20ms));
    matching = look();
  }
  return matching;
}

namespace {

tl::unexpected<Error> Several(const Selector& selector, std::uint32_t domain, const std::vector<Presence>& matching) {
  return Fail(Code::kInvalidArgument,
              fmt::format("'{}' means {} things on domain {}: say which by NAME@ID (the first digits are enough){}",
                          selector.text(), matching.size(), domain, ListText(matching)));
}

Status CheckWire(const Presence& found) {
  if (found.wire == kWireVersion) return {};
  return Fail(Code::kUnavailable,
              fmt::format("{} '{}' of {} speaks wire number {} (program {}), this program {} (program {}): use "
                          "programs of the same wire number",
                          ToString(found.kind), found.name, Printable(found.host), found.wire, Printable(found.version),
                          kWireVersion, Version()));
}

// The only one of `matching`, if there is any.
Result<std::optional<Presence>> Only(const Selector& selector, std::uint32_t domain,
                                     const std::vector<Presence>& matching) {
  if (matching.empty()) return std::optional<Presence>();
  if (matching.size() > 1) return Several(selector, domain, matching);
  ETUDE_RETURN_IF_ERROR(CheckWire(matching.front()));
  return std::optional<Presence>(matching.front());
}

}  // namespace

Result<std::optional<Presence>> Directory::Find(PresenceKind kind, const Selector& selector,
                                                std::chrono::nanoseconds timeout) {
  return Only(selector, impl_->participant.domain(), impl_->Await(timeout, [&] { return Matching(kind, selector); }));
}

Result<std::optional<Presence>> Directory::FindPublisher(const Selector& selector, std::chrono::nanoseconds timeout) {
  const auto publishers = impl_->Await(timeout, [&] {
    auto runs = Matching(PresenceKind::kRun, selector);
    return runs.empty() ? Matching(PresenceKind::kRelay, selector) : runs;
  });
  return Only(selector, impl_->participant.domain(), publishers);
}

Result<std::vector<Presence>> Directory::FindCampaign(const Selector& selector, std::chrono::nanoseconds timeout) {
  auto matching = impl_->Await(timeout, [&] { return Matching(PresenceKind::kCampaign, selector); });
  for (const auto& presence : matching) {
    const bool alone = matching.size() == 1;
    if (!alone && !AreShardsOfOneCampaign(matching.front(), presence))
      return Several(selector, impl_->participant.domain(), matching);
    ETUDE_RETURN_IF_ERROR(CheckWire(presence));
  }
  std::ranges::sort(matching, {}, &Presence::shard);
  return matching;
}

std::vector<Presence> Directory::Others(const Presence& own) {
  std::vector<Presence> others;
  for (auto& presence : Live()) {
    if (presence.kind != own.kind || presence.instance == own.instance) continue;
    if (presence.id != own.id && !LeaseTheSame(presence, own)) continue;
    // "data", "data/" and a link to it are one folder: its key says so, where it has one
    const bool same_folder =
        presence.folder_key == own.folder_key && (!own.folder_key.empty() || presence.folder == own.folder);
    const bool own_past = presence.host == own.host && same_folder;
    if (!own_past) others.push_back(std::move(presence));
  }
  return others;
}

// ---- Announcement ---------------------------------------------------------------------------------

struct Announcement::Impl {
  Directory directory;
  Writer<Presence> writer;
  Presence presence;
};

Announcement::Announcement(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Announcement::Announcement(Announcement&&) noexcept = default;
Announcement& Announcement::operator=(Announcement&&) noexcept = default;
Announcement::~Announcement() {
  if (impl_) (void)impl_->writer.Dispose(impl_->presence);
}

namespace {

tl::unexpected<Error> IsLive(const Presence& own, const std::vector<Presence>& others, std::uint32_t domain) {
  const auto has_its_id = [&](const Presence& other) { return other.id == own.id; };
  if (std::ranges::none_of(others, has_its_id))
    return Fail(
        Code::kUnavailable,
        fmt::format("{} '{}': {} of it, in '{}', has episodes that are leased elsewhere on domain {}:{}\nA shard "
                    "has one collector and one folder, and all shards one count: give this one the number that "
                    "is missing, or end the other by --adopt (one that was killed disappears by itself within "
                    "10 s). Is it somebody else's? Give yours another name: --set name=NAME",
                    ToString(own.kind), own.name, ShardText(own), own.folder, domain, ListText(others)));
  return Fail(
      Code::kUnavailable,
      fmt::format("{} '{}' in '{}' has id {}, which is live elsewhere on domain {}:{}\nIf this folder is a copy, "
                  "--new-id makes it another {}; if it is to go on in the other's place, --adopt ends that "
                  "one (one that was killed disappears by itself within 10 s)",
                  ToString(own.kind), own.name, own.folder, own.id, domain, ListText(others), ToString(own.kind)));
}

}  // namespace

Result<Announcement> Announcement::Open(const Participant& participant, Presence presence, Claim claim) {
  ETUDE_ASSIGN_OR_RETURN(auto directory, Directory::Open(participant));
  ETUDE_ASSIGN_OR_RETURN(auto writer, Writer<Presence>::Open(participant, kDirectoryPartition));
  directory.WaitForOthers();
  const auto others = directory.Others(presence);
  if (!others.empty() && claim != Claim::kAdopt) return IsLive(presence, others, participant.domain());
  for (const auto& other : others) presence.epoch = std::max(presence.epoch, other.epoch + 1);
  ETUDE_RETURN_IF_ERROR(writer.Write(presence));
  return Announcement(std::unique_ptr<Impl>(new Impl{std::move(directory), std::move(writer), std::move(presence)}));
}

const Presence& Announcement::presence() const { return impl_->presence; }

std::optional<Presence> Announcement::Successor() {
  const Presence& own = impl_->presence;
  for (auto& other : impl_->directory.Others(own)) {
    const bool earlier = IsOlder(other, own);
    if (other.epoch > own.epoch || (other.epoch == own.epoch && earlier)) return std::move(other);
  }
  return std::nullopt;
}

Error GivingWay(const Presence& own, const Presence& successor) {
  if (own.id != successor.id)
    return {
        Code::kUnavailable,
        fmt::format("{} '{}' in '{}' ends: {} of it is at work elsewhere, too, and with the better right:{}\nWhat is "
                    "here stays; give each shard one collector and one folder",
                    ToString(own.kind), own.name, own.folder, ShardText(own), ListText({successor}))};
  return {
      Code::kUnavailable,
      fmt::format("{} '{}' in '{}' ends: its id {} is at work elsewhere, too, and with the better right:{}\nWhat is "
                  "here stays; started with --new-id it is a {} of its own",
                  ToString(own.kind), own.name, own.folder, own.id, ListText({successor}), ToString(own.kind))};
}

}  // namespace etude::bus
