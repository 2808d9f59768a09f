// SPDX-License-Identifier: Apache-2.0
// What the gateway answers. Written by dashboard/web/types from dashboard/server/openapi.json: not edited by hand.

export type Problem = {
  type?: string;
  title: string;
  status: number;
  detail: string;
  /** what to do; a command where there is one */
  hint?: string;
  /** 409 of a pair: keys that differ */
  differences?: string[];
};

export type State = "running" | "silent" | "finished" | "stopped" | "failed" | "unknown";

export type Source = {
  /** what routes take; [A-Za-z0-9._@-]+ */
  id: string;
  /** campaign: seen on the bus only, no folder below the ones given */
  kind: "dataset" | "run" | "eval" | "campaign";
  /** for people */
  name: string;
  state: State;
  /** newest change; RFC 3339, UTC */
  updated: string | null;
  /** ms since the value was published or the file changed; null: not known */
  age_ms: number | null;
  /** seen on the bus now */
  live: boolean;
  /** relative to the folder given, for people */
  folder: string | null;
  /** the same, absolute, for commands */
  path: string | null;
  /** dataset: rollouts of an evaluation */
  role: "demonstrations" | "rollouts" | null;
};

export type Warning = {
  code: "worker_silent" | "no_commits" | "campaign_error" | "given_up" | "data_wait" | "loss_not_finite" | "disk" | "policy_refuses" | "process_silent" | "fingerprint" | "not_shown" | "not_searched" | "unreadable" | "run_failed" | "stage_budget" | "checkpoint_unserved" | "same_name";
  text: string;
  /** RFC 3339, UTC */
  since: string | null;
  /** page of the dashboard, e.g. /fleet?filter=w1 */
  link: string;
};

export type Share = {
  successes: number;
  /** 0..1 */
  share: number;
  /** Wilson, 95 % */
  low: number;
  high: number;
};

export type TaskSuccess = {
  /** or 'overall' */
  task: string;
  n: number;
  success: Share;
  success_latched: Share | null;
};

export type Tiles = {
  demonstrations: {
    /** id of the campaign or dataset */
    source: string;
    name: string;
    committed: number;
    total: number;
    given_up: number;
    /** failed attempts */
    failed: number;
    workers: number;
    per_min: number | null;
    eta_s: number | null;
    /** one value per 10 s, oldest first, at most 60 */
    history_per_min: number[];
    live: boolean;
  } | null;
  training: {
    source: string;
    name: string;
    step: number;
    /** planned; null: until stopped */
    steps: number | null;
    stage: number;
    stages: number;
    stage_name: string;
    loss: number | null;
    samples_per_s: number | null;
    /** share of a step, 0..1 */
    data_wait: number | null;
    eta_s: number | null;
    checkpoint_step: number | null;
    finished: boolean;
    /** newest validation, e.g. {"TAR3D.cm": 0.15} */
    errors: Record<string, number>;
    live: boolean;
  } | null;
  checkpoint: {
    /** run id */
    source: string;
    name: string;
    /** of the newest, on disk or as the trainer says */
    step: number;
    /** null: not on this disk */
    file: string | null;
    /** since it was written; null: not known */
    age_ms: number | null;
    /** policy servers of this run */
    servers: {
      host: string;
      /** that it serves */
      step: number;
      /** RFC 3339, UTC */
      since: string | null;
    }[];
  } | null;
  policy: {
    /** run id */
    source: string | null;
    name: string;
    /** policy servers at work */
    instances: number;
    checkpoint_step: number | null;
    /** ms since the value was published or the file changed; null: not known */
    age_ms: number | null;
    p50_ms: number | null;
    p95_ms: number | null;
    answers_per_s: number | null;
    sessions: number | null;
    may_drive: boolean | null;
    last_refusal: string | null;
  } | null;
  success: {
    source: string;
    kind: "eval" | "expert";
    name: string;
    done: number;
    episodes: number;
    tasks: TaskSuccess[];
    overall: TaskSuccess;
  } | null;
  ladder: {
    source: string;
    stages: Stage[];
  } | null;
  /** newest first, at most 12 */
  events: {
    /** RFC 3339, UTC */
    t: string;
    level: "info" | "warn" | "error";
    text: string;
    link: string;
  }[];
};

export type Home = {
  sentence: string;
  state: State;
  /** of this answer; RFC 3339, UTC */
  time: string;
  /** of the program */
  version: string;
  /** folders given */
  dirs: string[];
  /** DDS domain; null: no bus */
  domain: number | null;
  /** actions are available: a token was given at start */
  actions: boolean;
  /** of each kind what runs, then what is on the bus, of these what was begun last first; then by newest change; runs without files here last; at most 100 */
  sources: Source[];
  /** what etude up is at, of each folder given that has an up.json */
  ups: {
    folder: string;
    state: State;
    /** begin, collect and train, roll out, serve, drain, ended */
    phase: string | null;
    /** what the phase ends with, in words */
    goal: string | null;
    /** RFC 3339, UTC */
    started: string | null;
    /** RFC 3339, UTC */
    ended: string | null;
    /** its exit code */
    exit: number | null;
  }[];
  warnings: Warning[];
  tiles: Tiles;
};

export type Worker = {
  worker: string;
  host: string;
  /** id of its source */
  campaign: string;
  /** idle | plan | play | send */
  phase: string;
  /** phases of the last 60 s, oldest first, one letter a sample: i p y s, '.' not heard; at most 120 */
  strip: string;
  index: number | null;
  attempt: number | null;
  robot: string | null;
  task: string | null;
  target: string | null;
  stage: string | null;
  step: number | null;
  /** outcome of its last attempt */
  last: string | null;
  /** acknowledged since its start */
  episodes: number;
  failures: number;
  /** over the last 60 s */
  per_min: number | null;
  steps_per_s: number;
  frames_per_s: number;
  age_ms: number;
};

export type Process = {
  process: string;
  /** worker, collector, trainer, policy, gateway, ... */
  role: string;
  pid: number;
  version: string;
  since: string | null;
  rss_mb: number;
  /** cores in use */
  cpu: number;
  folder: string | null;
  /** share of the disk of its folder, 0..1 */
  disk_free: number | null;
  age_ms: number;
};

export type Host = {
  /** '?' of workers whose host no journal names */
  host: string;
  /** workers */
  slots: number;
  busy: number;
  /** of all its workers */
  episodes: number;
  /** of all its workers */
  failures: number;
  per_min: number | null;
  /** share of attempts that were committed, 0..1 */
  ok: number | null;
  plan_p50_s: number | null;
  plan_p95_s: number | null;
  rss_mb: number | null;
  /** cores in use by the processes of this host */
  cpu: number | null;
  version: string | null;
  fingerprint: string | null;
  age_ms: number;
  /** those that are not workers first; as many as workers were asked for */
  processes: Process[];
  /** as many as were asked for, of slots */
  workers: Worker[];
};

export type Fleet = {
  /** hosts that fit the filter */
  total: number;
  /** of all hosts that fit */
  workers: number;
  /** offset of the next page */
  next: number | null;
  per_min: number | null;
  ok: number | null;
  /** false: nothing on the bus, hosts come from journals */
  live: boolean;
  hosts: Host[];
};

export type CampaignStatus = {
  committed: number;
  total: number;
  /** committed + failed */
  attempts: number;
  given_up: number;
  workers: number;
  per_min: number | null;
  eta_s: number | null;
  /** '' when all is well */
  error: string;
  /** while its collector says so; '' otherwise */
  control: "" | "paused" | "draining" | "stopping";
  live: boolean;
  /** ms since the value was published or the file changed; null: not known */
  age_ms: number | null;
};

export type Timing = {
  /** that the sums are of */
  attempts: number;
  plan_s: number;
  step_s: number;
  render_s: number;
  deflate_s: number;
  send_s: number | null;
  plan_p50_s: number | null;
  plan_p95_s: number | null;
  plan_histogram: {
    /** 13 edges, logarithmic */
    edges_s: number[];
    /** 12 */
    counts: number[];
  };
};

export type Campaign = {
  id: string;
  name: string;
  state: State;
  /** dataset id; null: seen on the bus only */
  dataset: string | null;
  /** as written by its process; integers beyond 2^53 and every key named seed are strings */
  spec: Record<string, unknown> | null;
  spec_sha256: string | null;
  status: CampaignStatus;
  /** failed attempts by reason */
  failures: Record<string, number>;
  /** reason x stage x task x robot, all of them: beyond 500 rows the rare ones are added up, first without stage and robot, then without task, then as reason other */
  failures_by: {
    reason: string;
    stage: string | null;
    task: string;
    robot: string;
    count: number;
  }[];
  timing: Timing | null;
  tasks: string[];
  robots: string[];
};

export type Attempt = {
  index: number;
  attempt: number;
  /** u64 */
  seed: string;
  /** success, or the typed reason */
  outcome: string;
  /** in words */
  reason: string | null;
  stage: string | null;
  /** what touched */
  pair: string | null;
  robot: string;
  task: string;
  target: string;
  worker: string | null;
  /** RFC 3339, UTC */
  t: string | null;
  plan_s: number | null;
  step_s: number | null;
  render_s: number | null;
  deflate_s: number | null;
  /** its episode is in the dataset */
  has_pictures: boolean;
  /** dataset of its cached replay, whose pictures stand for those that it does not have */
  replay: string | null;
};

export type Attempts = {
  /** that was asked for */
  campaign: string;
  /** that fit */
  total: number;
  /** pass as before */
  next: string | null;
  /** newest first */
  rows: Attempt[];
};

export type Dataset = {
  id: string;
  name: string;
  folder: string;
  /** the same, absolute, for commands */
  path: string;
  role: "demonstrations" | "rollouts";
  /** id, of rollouts */
  eval: string | null;
  state: State;
  /** RFC 3339, UTC */
  updated: string | null;
  /** ms since the value was published or the file changed; null: not known */
  age_ms: number | null;
  /** identity.json */
  identity: string | null;
  schema_version: number;
  content: number;
  /** as written by its process; integers beyond 2^53 and every key named seed are strings */
  spec: Record<string, unknown>;
  spec_sha256: string;
  /** as written by its process; integers beyond 2^53 and every key named seed are strings */
  statistics: Record<string, unknown>;
  /** files there now */
  episodes: number;
  /** of these, those whose length and place are known: by the journal, or from files that were read so far */
  known: number;
  /** that the spec asks for; of one that was made of others (filter, split, merge, import) those that are there */
  total: number;
  failed_attempts: Record<string, number>;
  /** files that could not be read so far */
  unreadable: number;
  /** at most 20 */
  unreadable_files: {
    index: number;
    reason: string;
  }[];
  /** commits.jsonl is there */
  journal: boolean;
  /** filter keys: train, valid, test, and those of filters.json */
  keys: string[];
  cameras: string[];
  /** of episode files, as far as counted */
  bytes: number;
};

export type Episodes = {
  /** that fit the filter */
  total: number;
  /** episodes in the dataset */
  all: number;
  /** whose attributes are known; the others are being read and are null until then */
  known: number;
  /** pass as before */
  next: string | null;
  /** arrays of equal length, a row each */
  columns: {
    index: number[];
    task: (string | null)[];
    target: (string | null)[];
    reference: (string | null)[];
    robot: (string | null)[];
    outcome: (string | null)[];
    success: (boolean | null)[];
    split: string[];
    worker: (string | null)[];
    host: (string | null)[];
    instruction: (string | null)[];
    attempt: (number | null)[];
    steps: (number | null)[];
    frames: (number | null)[];
    bytes: (number | null)[];
    draws: (number | null)[];
    odd: (number | null)[];
    t: (string | null)[];
  };
};

export type Summary = {
  total: number;
  known: number;
  tasks: Record<string, number>;
  targets: Record<string, number>;
  robots: Record<string, number>;
  outcomes: Record<string, number>;
  splits: Record<string, number>;
  /** that committed them */
  workers: Record<string, number>;
  matrix: {
    task: string;
    target: string;
    count: number;
    /** from the spec; null: with a filter, or drawn */
    expected: number | null;
  }[];
  lengths: {
    edges_steps: number[];
    counts: number[];
  };
  /** scenes by number of draws */
  draws: Record<string, number>;
  /** most frequent first */
  words: {
    word: string;
    count: number;
  }[];
  /** of the targets at the start, world; at most 2,000, evenly taken */
  places: {
    index: number[];
    x_m: number[];
    y_m: number[];
    task: string[];
    target: string[];
  };
  /** largest first */
  odd: {
    index: number;
    odd: number;
    /** steps | path_m | jerk | joint_speed */
    what: string;
    task: string;
  }[];
};

export type Camera = {
  name: string;
  width_px: number;
  height_px: number;
  fovy_rad: number;
  frames: number;
  position_m: number[];
  /** camera in world; looks along -z, y up */
  quaternion_wxyz: number[];
};

export type Episode = {
  dataset: string;
  index: number;
  attempt: number;
  /** u64 */
  seed: string;
  campaign: string;
  robot: string;
  task: string;
  target: string;
  reference: string;
  /** object that stands in the way */
  obstacle: string | null;
  instruction: string;
  success: boolean;
  outcome: string;
  split: string;
  spec_sha256: string;
  scene_sha256: string;
  /** content number */
  version: string;
  steps: number;
  duration_s: number;
  control_rate_hz: number;
  /** control steps per picture; picture k belongs to step k*image_stride */
  image_stride: number;
  /** of its file */
  bytes: number;
  /** spans of the expert's stages */
  stages: {
    name: string;
    /** step */
    from: number;
    /** one after its last step */
    to: number;
  }[];
  /** spans that nobody imitates */
  unsupervised: {
    from: number;
    to: number;
  }[];
  objects: string[];
  tracks: {
    /** joint_pos, eef_pos, objects/coke/pose, ... */
    name: string;
    columns: number;
    labels: string[];
    /** m | rad | rad/s | px | - */
    unit: string;
  }[];
  cameras: Camera[];
  /** as written by its process; integers beyond 2^53 and every key named seed are strings */
  details: Record<string, unknown>;
  /** neighbour in the dataset */
  previous: number | null;
  next: number | null;
  worker: string | null;
  host: string | null;
  /** RFC 3339, UTC */
  t: string | null;
};

export type Replay = {
  /** replay.<hash>; null: it cannot be made again */
  id: string | null;
  state: "none" | "running" | "ready" | "impossible";
  why_not: string | null;
  /** while it runs */
  job: string | null;
  /** false: not ready, or it ended before anything moved */
  has_episode: boolean;
};

export type ReplayPlan = {
  index: number;
  attempt: number;
  /** u64 */
  seed: string;
  robot: string;
  task: string;
  target: string;
  reference: string;
  outcome: string;
  reason: string;
  steps: number;
  /** the draws of its start */
  scene: unknown;
  /** as in the episode's */
  details: unknown;
  motions: {
    /** control step at which it began */
    step: number;
    stages: string[];
    /** a push off the path */
    disturbance: boolean;
    /** of the tool in world, as planned */
    poses: number[][];
  }[];
  /** nearest pair of the arm and everything else, every so many steps */
  nearest: {
    step: number;
    distance_m: number;
    /** body of the arm, or what it holds */
    a: string;
    b: string;
    /** nearest point of a, in world; none where they touch */
    a_m?: number[];
    /** of b */
    b_m?: number[];
  }[];
};

export type ReplayGeometry = {
  /** of the robot, then the objects: the order of poses.f32 */
  bodies: string[];
  /** layout of poses.f32 */
  poses: Record<string, unknown>;
  /** convex pieces, each fixed to its body at pose */
  geometry: {
    name: string;
    /** one of bodies, or what stands still, in world */
    body: string;
    shape: "box" | "sphere" | "capsule" | "cylinder" | "convex";
    /** m. box: half sizes; sphere: radius; capsule, cylinder: radius, half length along z */
    size: number[];
    /** x y z (m), quaternion w x y z */
    pose: number[];
    /** convex: m, before pose */
    vertices?: number[][];
  }[];
};

export type Stage = {
  /** from 1 */
  stage: number;
  name: string;
  /** null: not reached */
  from_step: number | null;
  /** null: current or not reached */
  to_step: number | null;
  state: "done" | "current" | "ahead";
  /** why it ended: goal | budget | patience | ... */
  cause: string | null;
  reason: string | null;
};

export type Curriculum = {
  stages: Stage[];
  /** lines of curriculum.jsonl */
  advances: Record<string, unknown>[];
};

export type SeriesKey = {
  /** KIND/NAME, e.g. train/loss, valid/TAR3D.cm */
  key: string;
  /** train | valid */
  kind: string;
  name: string;
  module: string | null;
  /** cm | px | deg | share | s | 1/s */
  unit: string | null;
  /** lines that have it */
  n: number;
  /** of them null: not finite */
  nulls: number;
  last: number | null;
};

export type Run = {
  id: string;
  name: string;
  /** null: seen on the bus only */
  folder: string | null;
  /** the same, absolute, for commands */
  path: string | null;
  identity: string | null;
  state: State;
  /** RFC 3339, UTC */
  updated: string | null;
  /** ms since the value was published or the file changed; null: not known */
  age_ms: number | null;
  live: boolean;
  step: number;
  /** planned */
  steps: number | null;
  stage: number;
  stages: number;
  stage_name: string;
  elapsed_s: number | null;
  loss: number | null;
  samples_per_s: number | null;
  data_wait: number | null;
  /** in the training split */
  episodes: number | null;
  eta_s: number | null;
  checkpoint_step: number | null;
  /** in the order of the policy */
  modules: string[];
  goals: {
    module: string;
    /** in the unit shown */
    goal: number;
    /** newest, same unit */
    value: number | null;
    /** cm | px | -  */
    unit: string;
    reached: boolean | null;
    /** series key of the value */
    key: string | null;
  }[];
  keys: SeriesKey[];
  /** losses that were not finite, at most 100 */
  nulls: {
    step: number;
    key: string;
  }[];
  /** all values that were not finite */
  nulls_total: number;
  /** starts: the first, and each resume */
  lives: {
    from_step: number;
    /** RFC 3339, UTC */
    t: string | null;
  }[];
  end: {
    cause: "finished" | "stopped" | "failed";
    step: number | null;
    /** RFC 3339, UTC */
    t: string | null;
  } | null;
  /** dataset id that its checkpoints name; null: not below the folders given */
  dataset: string | null;
  /** as written by its process; integers beyond 2^53 and every key named seed are strings */
  config: Record<string, unknown> | null;
  /** the last line was not whole and was left out */
  torn: boolean;
};

export type GraphNode = {
  name: string;
  level: number;
  entity: string;
  quantity: string;
  reads: string[];
  query: string;
  attend: string[];
  /** of its decoder */
  inputs: string[];
  /** modules whose decoded values it takes */
  from: string[];
  between: string[];
  relative_to: string;
  detach: boolean;
  parameters: number | null;
  /** SI units: m, px, share wrong */
  error: number | null;
  trained_steps: number | null;
  /** that trains it first */
  stage: number | null;
  trained: boolean;
  frozen: boolean;
};

export type Graph = {
  /** file that parameters and errors are of */
  checkpoint: string | null;
  architecture: string | null;
  inputs: string[];
  nodes: GraphNode[];
  edges: {
    from: string;
    to: string;
    kind: "register" | "query" | "decoded";
  }[];
  /** left to right, order within a column is for drawing */
  columns: string[][];
};

export type Checkpoint = {
  file: string;
  step: number | null;
  stage: number | null;
  stages: number | null;
  stage_name: string | null;
  bytes: number;
  /** RFC 3339, UTC */
  modified: string;
  /** null: being computed */
  sha256: string | null;
  /** latest, best: links to this file */
  channels: string[];
  metrics: Record<string, number | null>;
  modules: Record<string, {
    /** what it decodes, in whose unit its error is: m, px of a pixel, the share that is wrong of a class or a task; null: config.yaml does not say */
    quantity: string | null;
    trained_steps: number | null;
    error: number | null;
  }>;
  /** numbers by module */
  parameters: Record<string, number>;
  /** hash */
  dataset: string | null;
  architecture: string | null;
  robot: string | null;
  joints: number | null;
  train_episodes: number | null;
  version: string | null;
  run: string | null;
  /** last stage reached */
  control_trained: boolean;
  refused: string | null;
  /** why its header could not be read */
  error: string | null;
  served_by: {
    host: string;
    /** RFC 3339, UTC */
    since: string | null;
  }[];
};

export type Checkpoints = {
  run: string;
  /** newest first */
  checkpoints: Checkpoint[];
  /** when the next one is due */
  next_step: number | null;
  /** processes that read what the run publishes: policy servers, relays and whoever else */
  subscribers: {
    /** role, process and host, where it says so */
    peer: string | null;
    /** DDS participant */
    participant: string;
  }[];
};

export type TaskReport = {
  task: string;
  n: number;
  success: Share;
  success_latched?: Share;
  with_violations?: number;
  violations?: Record<string, number>;
  with_others_moved?: number;
  error_cm?: Record<string, number>;
  error_before_contact_cm?: Record<string, number>;
};

export type Eval = {
  id: string;
  name: string;
  folder: string;
  /** the same, absolute, for commands */
  path: string;
  state: State;
  /** RFC 3339, UTC */
  updated: string | null;
  /** ms since the value was published or the file changed; null: not known */
  age_ms: number | null;
  campaign: string;
  run: string;
  /** run source, where it is known */
  run_id: string | null;
  checkpoint: {
    step: number | null;
    /** or its first 12 digits */
    sha256: string | null;
    file: string | null;
  } | null;
  /** u64 */
  seed: string;
  episodes: number;
  done: number;
  per_task: TaskReport[];
  overall: TaskReport;
  /** with errors, the paper's first */
  modules: string[];
  /** as written by its process; integers beyond 2^53 and every key named seed are strings */
  latency: Record<string, unknown> | null;
  /** as written by its process; integers beyond 2^53 and every key named seed are strings */
  scenes: Record<string, unknown> | null;
  /** as written by its process; integers beyond 2^53 and every key named seed are strings */
  extra: Record<string, unknown>;
  /** id of its rollouts */
  dataset: string | null;
  /** rollouts of which it was kept what their policy said */
  insights: number;
  /** as written by its process; integers beyond 2^53 and every key named seed are strings */
  spec: Record<string, unknown> | null;
};

export type EvalRow = {
  index: number;
  /** u64 */
  seed: string;
  task: string;
  target: string;
  reference: string;
  robot: string;
  instruction: string;
  success: boolean;
  success_latched: boolean;
  outcome: string;
  violations: string[];
  disturbed_objects: string[];
  steps: number;
  decisions: number;
  latency_steps: number;
  checkpoint_step: number;
  error_cm: Record<string, number>;
  error_before_contact_cm: Record<string, number>;
  /** the first decision of which a module's output was off by more than over_cm; missing: there is none */
  first_bad?: {
    module: string;
    /** counts from 0 */
    decision: number;
    /** control step */
    step: number;
    error_cm: number;
    /** what is bad */
    over_cm: number;
  };
  /** address of the video made by eval */
  video: string | null;
  /** it was kept what its policy said, see /evals/{id}/insights/{index} */
  insight: boolean;
};

export type EvalRows = {
  total: number;
  /** of total */
  failed: number;
  /** offset of the next page */
  next: number | null;
  rows: EvalRow[];
};

export type PairCounts = {
  /** or 'overall' */
  task: string;
  n: number;
  both: number;
  only_a: number;
  only_b: number;
  neither: number;
  share_a: number;
  share_b: number;
  /** share_a - share_b */
  difference: number;
  /** Newcombe's paired score interval, 95 % */
  low: number;
  high: number;
  /** exact McNemar, two-sided */
  p: number;
};

export type Pair = {
  a: string;
  b: string;
  /** rollouts that only one has */
  unpaired: number;
  n: number;
  both: number;
  only_a: number;
  only_b: number;
  neither: number;
  share_a: number;
  share_b: number;
  /** share_a - share_b */
  difference: number;
  /** Newcombe's paired score interval, 95 % */
  low: number;
  high: number;
  /** exact McNemar, two-sided */
  p: number;
  latched: PairCounts;
  per_task: PairCounts[];
  /** rollouts that differ first; at most 1,000 */
  rows: {
    index: number;
    seed: string;
    task: string;
    target: string;
    a: boolean;
    b: boolean;
  }[];
};

export type Diff = {
  a: string;
  b: string;
  /** keys that differ */
  total: number;
  /** at most 500 */
  keys: {
    key: string;
    a: unknown;
    b: unknown;
  }[];
};

export type LogLine = {
  source: string;
  /** byte offset of the line in its file */
  n: number;
  /** as written; local time of day of a line of --log json */
  t: string | null;
  /** the same with its day, which of a time of day is reckoned back from the file's last change; RFC 3339, UTC; null: it says no time */
  at: string | null;
  level: "debug" | "info" | "warn" | "error" | null;
  /** at most 4,000 characters */
  text: string;
};

export type Logs = {
  sources: {
    id: string;
    name: string;
    bytes: number;
    /** RFC 3339, UTC */
    updated: string;
  }[];
  /** oldest first */
  lines: LogLine[];
  /** pass as before for older lines; null: there are none */
  next: string | null;
  /** files that were looked at: without a source the 12 that changed last */
  searched: number;
  /** how far back this page looked, RFC 3339, UTC; null: to the begin of the files */
  back_to: string | null;
};

export type Event = {
  process: string;
  role: string;
  host: string;
  /** counts those of the process: a gap is what was dropped */
  n: number;
  t: string;
  level: "warn" | "error";
  code: string;
  text: string;
};

export type Events = {
  total: number;
  /** newest first */
  events: Event[];
};

export type Peer = {
  /** role, pid and host; empty where it does not say */
  peer: string;
  participant: string;
  partitions: string[];
};

export type Topic = {
  topic: string;
  types: string[];
  qos: string[];
  /** why a reader does not get what a writer writes */
  problems: string[];
  writers: Peer[];
  readers: Peer[];
  /** as its writers count; null: none counts */
  per_s: number | null;
  bytes_per_s: number | null;
  /** carries episodes: counted, never read */
  bulk: boolean;
};

export type Topics = {
  domain: number | null;
  error: string | null;
  topics: Topic[];
};

export type Sample = {
  partition: string;
  age_ms: number;
  /** byte fields as {bytes: n} */
  message: Record<string, unknown>;
};

export type Samples = {
  topic: string;
  /** the newest of each partition; none: none came since somebody began to look */
  samples: Sample[];
};

export type ModuleSays = {
  entity?: string;
  quantity?: string;
  unit?: string;
  value?: unknown;
  probability?: number;
  /** px */
  soft_argmax?: number[];
};

export type ModuleError = {
  /** a name, or numbers in unit */
  truth: unknown;
  /** a distance; of a name 0 where it is right, else 1 */
  error: number;
  /** m | px | - */
  unit: string;
  /** of a pose: the angle between both */
  turned_rad?: number;
};

export type Insight = {
  run: string;
  checkpoint_step: number;
  sentence: string;
  modules: Record<string, ModuleSays>;
  /** the same with the what-if of the request */
  what_if: Record<string, ModuleSays> | null;
  attention: Record<string, ModuleAttention>;
  view: PictureView;
  /** x, y, z (m) and gripper 0..1 */
  waypoints: number[][];
  /** the same with the what-if; empty: none was asked */
  what_if_waypoints: number[][];
  /** of the sentence, and how far the planned waypoints move without each, on average; empty: not asked, or nothing is planned */
  words: {
    word: string;
    moves_m: number;
  }[];
  /** as they were asked with, the arm's first */
  joints: {
    name: string;
    value: number;
    unit: string;
    /** how far the planned waypoints move where it is at its mean in training */
    moves_m: number | null;
  }[];
  truth: {
    target: string;
    reference: string | null;
    instruction: string;
    /** hand and objects, px */
    pixels: Record<string, number[]>;
    /** hand and objects, x, y, z in world, m */
    positions: Record<string, number[]>;
    /** as demonstrated, up to the first that nobody is to imitate; empty: of a rollout, or of another sentence */
    waypoints: number[][];
    /** mean distance of the planned waypoints from those */
    waypoints_error_m: number | null;
    /** by module, of those whose truth is known: of another sentence than the record's, target and reference are not */
    errors: Record<string, ModuleError>;
  };
};

export type KeptInsights = {
  eval: string;
  index: number;
  /** of the rollouts */
  dataset: string;
  instruction: string;
  outcome: string;
  decisions: {
    /** control step */
    step: number;
    /** of the episode; null: none was recorded at that step */
    picture: number | null;
    /** it was kept what the policy said */
    kept: boolean;
  }[];
};

export type ModuleAttention = {
  /** of the picture's grid; 0: it does not read the picture */
  rows: number;
  columns: number;
  /** of its attention that falls on the picture, 0..1 */
  share: number;
  /** what else it reads: language, joints, self, modules */
  keys: string[];
  /** rows * columns, row by row, the mean of its heads */
  weights: number[];
  /** one for each of keys, the mean of its heads */
  key_weights: number[];
  /** the same of each head; of a recorded picture only */
  heads?: {
    weights: number[];
    key_weights: number[];
  }[];
};

export type PictureView = {
  u: number;
  v: number;
  width: number;
  height: number;
};

export type Action = {
  action: string;
  description: string;
  arguments: {
    name: string;
    required: boolean;
    description: string;
  }[];
  available: boolean;
  why_not: string | null;
};

export type Actions = {
  /** a token was given at start */
  enabled: boolean;
  /** this request brought it */
  authorized: boolean;
  actions: Action[];
};

export type Job = {
  id: string;
  action: string;
  /** for copying */
  command: string;
  state: "running" | "done" | "failed";
  /** it was asked to end; asked again it ends at once */
  stopping: boolean;
  /** 0..1 */
  progress: number | null;
  /** RFC 3339, UTC */
  started: string;
  /** RFC 3339, UTC */
  ended: string | null;
  exit_code: number | null;
  /** last lines, at most 200 */
  log: string[];
  /** as written by its process; integers beyond 2^53 and every key named seed are strings */
  result: Record<string, unknown> | null;
};

export type Ready = {
  ready: boolean;
  sentence: string;
  sources: number;
  bus: boolean;
};

export type PlaySession = {
  session: string;
  host: string;
  /** whose policy it asks */
  run: string;
  phase: "rest" | "moving" | "ended";
  age_ms: number;
  /** number of its newest picture; 0: none yet */
  frame: number;
  /** campaign, robot, index, seed, camera, tasks, campaign_objects, table_half_m, objects: name, x, y, z, yaw (m, rad), half_extent, hidden */
  scene: Record<string, unknown>;
  sentence: string;
  /** task, target, reference that the judge takes; null: not judged */
  meaning: null | Record<string, unknown>;
  step: number;
  max_steps: number;
  /** doing, judged, done, held, dwell, words, touched, success_latched, violations, disturbed */
  judge: Record<string, unknown>;
  outcome: string;
  reason: string;
  joints: number[];
  /** of the last answer: x, y, z (m, world), rotation in 6D, gripper */
  waypoints: number[][];
  modules: Record<string, unknown>;
  checkpoint_step: number;
  policy_ms: number;
  speed: number;
  attempts: number;
  successes: number;
};

export type PlayInsight = {
  /** of this one; 0: none came yet, and the rest is empty */
  number: number;
  checkpoint_step: number;
  modules: Record<string, ModuleSays>;
  attention: Record<string, ModuleAttention>;
  view: PictureView;
};
