// SPDX-License-Identifier: Apache-2.0
#include "services/policy/insight_viewer.h"

#include <utility>

#include "services/bus/topic.h"
#include "services/policy/insight_stream.h"

namespace etude::policy {

struct InsightViewer::Impl {
  std::string session;
  InsightStream stream;
};

InsightViewer::InsightViewer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
InsightViewer::InsightViewer(InsightViewer&&) noexcept = default;
InsightViewer& InsightViewer::operator=(InsightViewer&&) noexcept = default;
InsightViewer::~InsightViewer() = default;

Result<InsightViewer> InsightViewer::Open(const bus::Participant& participant, const std::string& run,
                                          const std::string& session) {
  ETUDE_ASSIGN_OR_RETURN(const auto selector, ParseSelector(run, "look into the policy of run"));
  bus::InsightWish wish;
  wish.viewer = "viewer-" + bus::UniquePeerName();
  wish.session = session;
  ETUDE_ASSIGN_OR_RETURN(auto stream, InsightStream::Open(participant, selector, std::move(wish)));
  return InsightViewer(std::unique_ptr<Impl>(new Impl{session, std::move(stream)}));
}

Result<std::optional<Insight>> InsightViewer::Take() {
  ETUDE_ASSIGN_OR_RETURN(auto insights, impl_->stream.Take());
  std::erase_if(insights, [&](const bus::Insight& insight) { return insight.session != impl_->session; });
  if (insights.empty()) return std::optional<Insight>();
  ETUDE_ASSIGN_OR_RETURN(auto newest, ReadInsight(insights.back()));
  return std::optional<Insight>(std::move(newest));
}

}  // namespace etude::policy
