// SPDX-License-Identifier: Apache-2.0
// The structs of a campaign's work and of a policy's conversation as heads of frames, and back. What comes back is
// checked: a child's head is another process's word.
#pragma once

#include "services/campaign/worker_client.h"
#include "services/policy/policy_types.h"
#include "worker/host/frame.h"

namespace etude::host {

OrderedJson CampaignHead(const campaign::JoinedCampaign& joined);
Result<campaign::JoinedCampaign> CampaignOf(const OrderedJson& head);

OrderedJson WorkHead(const campaign::WorkItem& item);  ///< without `progress`
Result<campaign::WorkItem> WorkOf(const OrderedJson& head, const CampaignSpec& spec);

OrderedJson ResultHead(const campaign::WorkResult& result);  ///< without the episode
/// @error kCorrupt
Result<campaign::WorkResult> ResultOf(Frame frame);

OrderedJson QuestionHead(const policy::Question& question);  ///< without the picture
/// The picture stays in `frame`, which must outlive the question. @error kCorrupt: also where sizes do not fit
Result<policy::Question> QuestionOf(const Frame& frame);

OrderedJson AnswerHead(const policy::Answer& answer);
Result<policy::Answer> AnswerOf(const OrderedJson& head);

OrderedJson ErrorHead(const Error& error);
Error ErrorOf(const OrderedJson& head);

}  // namespace etude::host
