// SPDX-License-Identifier: Apache-2.0
#include "services/bus/participant.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <malloc.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cctype>
#include <map>
#include <mutex>
#include <optional>
#include <random>
#include <string_view>
#include <tuple>

#include "services/bus/access.h"
#include "services/bus/network.h"
#include "services/bus/owner.h"
#include "services/bus/participant_state.h"
#include "services/bus/participant_watch.h"
#include "services/bus/profile.h"
#include "services/bus/security_log.h"
#include "services/bus/typed.h"
#include "services/core/clock.h"
#include "services/core/file.h"
#include "services/core/identity.h"
#include "services/core/log.h"
#include "services/core/thread_annotations.h"

namespace etude::bus {
namespace {

// How often a library said something, but for the numbers in it. Of a link that is down it says so at every datagram.
class Repetitions {
 public:
  // @returns how often by now, where that is to be told: at 1, 2, 4, 8, ...
  std::optional<std::uint64_t> Count(std::string text) {
    std::erase_if(text, [](unsigned char c) { return std::isdigit(c) != 0; });
    if (counts_.size() >= kMostTexts) counts_.clear();
    const std::uint64_t count = ++counts_[text];
    return std::has_single_bit(count) ? std::optional(count) : std::nullopt;
  }

 private:
  static constexpr std::size_t kMostTexts = 256;
  std::map<std::string, std::uint64_t> counts_;
};

// Cyclone explains its failures only in its log: keep the last explanation for our message.
struct DdsLog {
  Mutex mutex;
  std::string last_error ETUDE_GUARDED_BY(mutex);
  Repetitions repetitions ETUDE_GUARDED_BY(mutex);
  SecurityLines security;
};

DdsLog& GetDdsLog() {
  static auto* const log = new DdsLog;  // outlives DDS's threads on purpose
  return *log;
}

void OnDdsLog(void*, const dds_log_data_t* data) {
  std::string text(data->message, data->size);
  while (!text.empty() && text.back() == '\n') text.pop_back();
  const bool is_error = (data->priority & (DDS_LC_FATAL | DDS_LC_ERROR)) != 0;
  if (is_error) {
    auto& log = GetDdsLog();
    const MutexLock lock(log.mutex);
    log.last_error = text;
  }
  if (!is_error && (data->priority & DDS_LC_WARNING) == 0) return;
  if (const auto line = TranslateSecurity(text)) {
    if (const auto once = GetDdsLog().security.Take(*line)) Log().warn("{}", *once);
    return;
  }
  const auto count = [&] {
    auto& log = GetDdsLog();
    const MutexLock lock(log.mutex);
    return log.repetitions.Count(text);
  }();
  if (count) Log().warn("dds: {}{}", text, *count > 1 ? fmt::format(" ({} times by now)", *count) : "");
}

std::string TakeLastDdsError() {
  auto& log = GetDdsLog();
  const MutexLock lock(log.mutex);
  return std::exchange(log.last_error, {});
}

std::string Advice(const std::string& explanation) {
  if (explanation.find("denied by default rule") != std::string::npos) {
    return "; its permissions do not name this domain: issue it with --domain";
  }
  if (explanation.find("participant index") != std::string::npos) {
    return "; raise Discovery/MaxAutoParticipantIndex in the profile (`etude doctor net --write-profile` has "
           "--processes), give fewer --workers, end other processes of this domain, or use another domain";
  }
  if (explanation.find("interface") != std::string::npos || explanation.find("address") != std::string::npos) {
    return "; name an existing interface in the profile's General/Interfaces (see 'ip address' and "
           "deploy/dds)";
  }
  if (explanation.find("receive buffer") != std::string::npos) {
    return fmt::format("; run 'sysctl -w net.core.rmem_max={}' or lower SocketReceiveBufferSize", kWantedReceiveBuffer);
  }
  return "; check the profile (see deploy/dds)";
}

Error OpenError(dds_return_t code, const ParticipantConfig& config, std::string_view what) {
  const std::string explanation = TakeLastDdsError();
  Error error = DdsError(code, fmt::format("{} of DDS domain {}", what, config.domain));
  error.code = Code::kUnavailable;
  if (!explanation.empty()) error.message += ": " + explanation;
  error.message += Advice(explanation);
  return error;
}

struct Domains {
  Mutex mutex;
  struct Item {
    std::weak_ptr<Entity> domain;
    std::string profile;
  };
  std::map<std::uint32_t, Item> by_id ETUDE_GUARDED_BY(mutex);
};

Domains& GetDomains() {
  static auto* const domains = new Domains;
  return *domains;
}

// The identity as properties of the participant: the profile stays the user's.
Qos SecurityQos(const security::Identity& identity) {
  Qos qos(dds_create_qos());
  const auto set = [&](const char* name, const std::string& value) { dds_qset_prop(qos.get(), name, value.c_str()); };
  const auto file = [&](const char* name) { return "file:" + (identity.folder / name).string(); };
  for (const auto& [part, library, function] : {std::tuple{"auth", "dds_security_auth", "authentication"},
                                                {"crypto", "dds_security_crypto", "crypto"},
                                                {"access", "dds_security_ac", "access_control"}}) {
    const std::string prefix = std::string("dds.sec.") + part + ".library.";
    set((prefix + "path").c_str(), library);
    set((prefix + "init").c_str(), std::string("init_") + function);
    set((prefix + "finalize").c_str(), std::string("finalize_") + function);
  }
  set("dds.sec.auth.identity_ca", file("identity-ca.pem"));
  set("dds.sec.auth.private_key", file("key.pem"));
  set("dds.sec.auth.identity_certificate", file("cert.pem"));
  set("dds.sec.access.permissions_ca", file("permissions-ca.pem"));
  set("dds.sec.access.governance", file("governance.p7s"));
  set("dds.sec.access.permissions", file("permissions.p7s"));
  set("org.eclipse.cyclonedds.sec.auth.crl", file("crl.pem"));
  // its discovery messages are in clear: they need not say more than they must
  set("__ProcessName", kNoProcessName);
  return qos;
}

// A process has a domain once; participants with the same profile share it.
Result<std::shared_ptr<Entity>> OpenDomain(const ParticipantConfig& config, const std::string& profile) {
  auto& domains = GetDomains();
  const MutexLock lock(domains.mutex);
  auto& item = domains.by_id[config.domain];
  if (auto domain = item.domain.lock()) {
    if (item.profile != profile) {
      return Fail(Code::kUnavailable, fmt::format("open DDS domain {}: this process already has it open with another "
                                                  "profile",
                                                  config.domain));
    }
    return domain;
  }
  dds_set_log_sink(OnDdsLog, nullptr);
  TakeLastDdsError();
  const dds_entity_t handle = dds_create_domain(config.domain, profile.c_str());
  if (handle < 0) return Fail(OpenError(handle, config, "open"));
  auto domain = std::make_shared<Entity>(handle);
  item = {domain, profile};
  return domain;
}

// Of this process.
bool HasAnotherDomain(std::uint32_t than) {
  auto& domains = GetDomains();
  const std::scoped_lock lock(domains.mutex);
  return std::ranges::any_of(domains.by_id,
                             [than](const auto& item) { return item.first != than && !item.second.domain.expired(); });
}

// Each chunk is a malloc and a free of hundreds of kilobytes on either side. By default glibc gives such
// memory back to the kernel every time, and the page faults cost more than the copies.
void KeepChunksOnTheHeap() {
  static std::once_flag once;
  std::call_once(once, [] {
    ::mallopt(M_MMAP_THRESHOLD, 4 << 20);
    ::mallopt(M_TRIM_THRESHOLD, 64 << 20);
  });
}

void WarnAboutReceiveBuffer() {
  static std::once_flag once;
  std::call_once(once, [] {
    const auto bytes = LargestReceiveBuffer();
    if (bytes && *bytes < kWantedReceiveBuffer)
      Log().warn("socket buffers are limited: bursts are slower; run 'sysctl -w net.core.rmem_max={}' rmem_max={}",
                 kWantedReceiveBuffer, *bytes);
  });
}

// The machine's name as a part of a partition's: what may not be in it becomes "-".
std::string PlainHostName() {
  constexpr std::size_t kLongest = 64;
  std::string name = HostName().substr(0, kLongest);
  for (char& c : name) {
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
    if (!IsPlainName(std::string_view(&c, 1))) c = '-';
  }
  return name.empty() ? "host" : name;
}

// @error kInvalidArgument
Result<std::string> AddressOf(const ParticipantConfig& config, const std::optional<security::Identity>& identity) {
  if (config.address.empty()) return identity ? identity->name : AddressOnHost(PlainHostName(), std::random_device()());
  if (IsPlainName(config.address)) return config.address;
  return Fail(Code::kInvalidArgument, fmt::format("address '{}': must match [a-z0-9_-]{{1,64}}", config.address));
}

Result<Endpoint> OpenEndpoint(const Participant& participant, const std::vector<std::string>& partitions,
                              const dds_topic_descriptor_t& type, const std::string& topic, const TopicQos& topic_qos,
                              bool is_writer) {
  for (const auto& partition : partitions) ETUDE_RETURN_IF_ERROR(CheckPartition(partition));
  if (!IsKnownTopic(topic)) {
    return Fail(Code::kInvalidArgument,
                fmt::format("topic '{}' is not in the table of topics (services/bus/access.h)", topic));
  }
  Endpoint out;
  out.state = participant.state();
  out.is_writer = is_writer;
  const dds_entity_t parent = out.state->participant.get();
  const Qos qos = MakeQos(topic_qos);
  // the same for writers and readers of a topic, which may both be in this process
  const Qos shared_qos = MakeQos({topic_qos.transient_local, 1});
  const Qos group_qos = MakePartitionQos(partitions);
  const std::string what = fmt::format("{} of topic '{}' in partition '{}'", is_writer ? "writer" : "reader", topic,
                                       fmt::join(partitions, "', '"));
  ETUDE_ASSIGN_OR_RETURN(out.group, CheckEntity(is_writer ? dds_create_publisher(parent, group_qos.get(), nullptr)
                                                          : dds_create_subscriber(parent, group_qos.get(), nullptr),
                                                what));
  ETUDE_ASSIGN_OR_RETURN(out.topic,
                         CheckEntity(dds_create_topic(parent, &type, topic.c_str(), shared_qos.get(), nullptr), what));
  const dds_entity_t group = out.group.get();
  ETUDE_ASSIGN_OR_RETURN(out.endpoint,
                         CheckEntity(is_writer ? dds_create_writer(group, out.topic.get(), qos.get(), nullptr)
                                               : dds_create_reader(group, out.topic.get(), qos.get(), nullptr),
                                     what));
  out.traffic = out.state->TrafficOf(topic, is_writer);
  out.traffic->Join(out.endpoint.get());
  return out;
}

}  // namespace

void Traffic::Join(dds_entity_t endpoint) {
  const MutexLock lock(mutex);
  // those that are gone make room: a worker opens some for every campaign that it joins
  std::erase_if(endpoints, [](dds_entity_t other) { return dds_get_parent(other) < 0; });
  endpoints.push_back(endpoint);
}

int Traffic::Matched(bool is_writer) {
  const MutexLock lock(mutex);
  int matched = 0;
  for (const dds_entity_t endpoint : endpoints) {
    // not by the matched status: reading that takes its news from whoever waits for it
    const dds_return_t count = is_writer ? dds_get_matched_subscriptions(endpoint, nullptr, 0)
                                         : dds_get_matched_publications(endpoint, nullptr, 0);
    matched += std::max(count, 0);
  }
  return matched;
}

std::shared_ptr<Traffic> Participant::State::TrafficOf(const std::string& topic, bool is_writer) {
  const MutexLock lock(mutex);
  auto& traffic_of = traffic[{topic, is_writer}];
  if (!traffic_of) traffic_of = std::make_shared<Traffic>();
  return traffic_of;
}

Error DdsError(dds_return_t code, std::string_view attempted) {
  Code kind = Code::kUnavailable;
  if (code == DDS_RETCODE_TIMEOUT) kind = Code::kTimeout;
  if (code == DDS_RETCODE_BAD_PARAMETER) kind = Code::kInvalidArgument;
  if (code == DDS_RETCODE_OUT_OF_RESOURCES) kind = Code::kExhausted;
  const char* const advice = code == DDS_RETCODE_NOT_ALLOWED_BY_SECURITY
                                 ? "; this identity's roles, campaigns and runs do not include it (etude security show)"
                                 : "";
  return {kind, fmt::format("{}: {}{}", attempted, dds_strretcode(code), advice)};
}

namespace {

// Under security the others know a participant that they have admitted by its endpoints: one that has none for a while
// would look lost (participant_watch.h). Every role may read this topic.
Status StayVisible(const Participant& participant) {
  ETUDE_ASSIGN_OR_RETURN(Endpoint reader, OpenReaderOf<Presence>(participant, kDirectoryPartition));
  participant.state()->visible = {std::move(reader.group), std::move(reader.topic), std::move(reader.endpoint)};
  return {};
}

}  // namespace

Result<Participant> Participant::Open(const ParticipantConfig& config) {
  if (config.domain > 230) {
    return Fail(Code::kInvalidArgument, fmt::format("DDS domain {}: expected 0 to 230", config.domain));
  }
  ETUDE_ASSIGN_OR_RETURN(const std::string profile, ProfileText(config.profile));
  auto state = std::make_shared<State>();
  Qos qos;
  if (!config.security.empty()) {
    ETUDE_ASSIGN_OR_RETURN(state->identity, security::OpenIdentity(config.security, config.roles));
    ETUDE_RETURN_IF_ERROR(CheckSecuredProfile(profile));
    qos = SecurityQos(*state->identity);
  }
  ETUDE_ASSIGN_OR_RETURN(state->address, AddressOf(config, state->identity));
  ETUDE_ASSIGN_OR_RETURN(state->domain, OpenDomain(config, profile));
  TakeLastDdsError();
  const dds_entity_t handle = dds_create_participant(config.domain, qos.get(), nullptr);
  if (handle < 0) return Fail(OpenError(handle, config, "join"));
  state->participant = Entity(handle);
  state->id = config.domain;
  if (state->identity) {
    // a policy server's second domain is the robots': who knocks there must not end it for the first one's, too
    const bool waits = config.joins_another || IsHub(config.roles, *state->identity);
    const auto alone = HasAnotherDomain(config.domain) ? ParticipantWatch::Alone::kStays
                       : waits                         ? ParticipantWatch::Alone::kWaits
                                                       : ParticipantWatch::Alone::kEnds;
    state->watch = ParticipantWatch::Start(*state, *state->identity, LeaseSeconds(profile), alone);
  }
  WarnAboutReceiveBuffer();
  KeepChunksOnTheHeap();
  Participant participant(state);
  if (state->identity) ETUDE_RETURN_IF_ERROR(StayVisible(participant));
  return participant;
}

Participant::Participant(std::shared_ptr<State> state) : state_(std::move(state)) {}
Participant::Participant(Participant&&) noexcept = default;
Participant& Participant::operator=(Participant&&) noexcept = default;
Participant::~Participant() = default;

std::uint32_t Participant::domain() const { return state_->id; }
bool Participant::secured() const { return state_->identity.has_value(); }
const std::string& Participant::address() const { return state_->address; }
Participant Participant::Share() const { return Participant(state_); }
bool Participant::AllAdmitted() const {
  const PeersSeen peers = LookAround(*state_);
  return std::ranges::includes(peers.admitted, peers.seen);
}

Result<Endpoint> OpenWriter(const Participant& participant, const std::string& partition,
                            const dds_topic_descriptor_t& type, const std::string& topic, const TopicQos& qos) {
  return OpenEndpoint(participant, {partition}, type, topic, qos, true);
}

Result<Endpoint> OpenReader(const Participant& participant, const std::string& partition,
                            const dds_topic_descriptor_t& type, const std::string& topic, const TopicQos& qos) {
  return OpenEndpoint(participant, {partition}, type, topic, qos, false);
}

Result<Endpoint> OpenReaderIn(const Participant& participant, const std::vector<std::string>& partitions,
                              const dds_topic_descriptor_t& type, const std::string& topic, const TopicQos& qos) {
  return OpenEndpoint(participant, partitions, type, topic, qos, false);
}

void TellMalformed(std::string_view topic, std::uint64_t count) {
  if (std::has_single_bit(count)) Log().warn("malformed samples were dropped topic={} count={}", topic, count);
}

int MatchedReaders(const Endpoint& writer) {
  dds_publication_matched_status_t status{};
  dds_get_publication_matched_status(writer.get(), &status);
  return static_cast<int>(status.current_count);
}

int MatchedWriters(const Endpoint& reader) {
  dds_subscription_matched_status_t status{};
  dds_get_subscription_matched_status(reader.get(), &status);
  return static_cast<int>(status.current_count);
}

std::string UniquePeerName() {
  std::random_device device;
  return fmt::format("{}-{}-{:04x}", HostName(), ::getpid(), device() & 0xffffu);
}

}  // namespace etude::bus
