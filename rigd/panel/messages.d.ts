// Made by scripts/page_types.py from rigd/panel/messages.py: do not edit.

declare namespace Api {
  interface ActArguments {
    device: string;
    action: string;
  }
  interface ActionReply {
    said: string;
  }
  interface ActionView {
    device: string;
    action: string;
    doc: string;
  }
  interface Answered {
    prompt_id: number;
    value: number | string | boolean;
  }
  interface CalibrateArguments {
    run: string;
    days?: number;
    write?: boolean;
  }
  interface CertificateView {
    whose: "daemon" | "authority" | "client";
    name: string;
    until_ns: number;
  }
  interface CheckReport {
    ok: boolean;
    problems: ProblemView[];
    trials: number;
    prompts: number;
  }
  interface Checked {
    procedure: ProcedureFile;
    set?: Record<string, string>;
  }
  interface ClientUser {
    identity: string;
    user: string;
  }
  interface ComparedRuns {
    runs: string[];
    offset?: number;
    length?: number;
  }
  interface ControllerView {
    setpoint: string;
    output: string;
  }
  interface Daemon {
    version: string;
    pid: number;
    started_ns: number;
    descriptors: number;
    descriptors_most: number;
    unauthenticated_ended: number;
    accept_pauses: number;
  }
  interface DifferenceView {
    what: string;
    here: string;
    there: string;
  }
  interface Events {
    events: RigEvent[];
    next: number;
  }
  interface InterlockName {
    interlock: string;
    since_ns?: number | null;
  }
  interface InterlockView {
    name: string;
    source: string;
    low: number | string | null;
    high: number | string | null;
    action: "warn" | "end_trial" | "stop" | "abort" | "estop";
    priority: "low" | "medium" | "high" | "critical";
    latch: boolean;
    message: string;
  }
  interface Interrupted {
    run: string;
    reason: string;
    trials_done: number;
    trials_total: number;
  }
  interface Invitation {
    code: string;
  }
  interface LastRun {
    run: string;
    ending: string;
    reason: string;
    exit_code: number;
    recorded: boolean;
  }
  interface LatestReply {
    value: number | null;
    age_s: number;
  }
  interface LatestValues {
    t_ns: number;
    values: Record<string, LatestReply>;
  }
  interface LeaseView {
    holder: ClientUser | null;
    until_ns: number;
    asked_by: ClientUser[];
  }
  interface LiveDescription {
    kind: "describe";
    describe: PageDescription;
  }
  interface LiveEvent {
    kind: "event";
    event: PageEvent;
  }
  interface LiveLatest {
    kind: "latest";
    latest: LatestValues;
  }
  interface LiveLink {
    kind: "panel";
    panel: RigLink;
  }
  interface LiveSkipped {
    kind: "skipped";
    skipped: number;
  }
  interface LiveStatus {
    kind: "status";
    status: PageStatus;
  }
  type NoArguments = Record<string, never>;
  type Nothing = Record<string, never>;
  interface OperatorNotice {
    t_ns: number;
    level: "info" | "warning" | "error";
    text: string;
  }
  interface PageChannel {
    name: string;
    unit: string;
    display: string;
    doc: string;
    low: number | null;
    high: number | null;
    raw_of: string | null;
    factor: number;
    offset: number;
  }
  interface PageDescription {
    rig: string;
    title: string;
    simulated: boolean;
    streams: PageStream[];
    setpoints: SetpointView[];
    interlocks: InterlockView[];
    controllers: ControllerView[];
    actions: ActionView[];
    role: Role;
    roles: Record<string, Role>;
    sizes: Sizes;
    stated: StatedView[];
    poses: PagePose[];
  }
  interface PageDryRun {
    ok: boolean;
    physics: "plant" | "sibling" | "none";
    sibling: string;
    duration_s: number;
    known_s: number | null;
    trials: number;
    steps: StepView[];
    peaks: PagePeak[];
    refusals: string[];
    differences: DifferenceView[];
    notes: string[];
  }
  interface PageEvent {
    v: 1;
    seq: number;
    t_ns: number;
    kind: string;
    trial: number;
    data: Record<string, JsonValue>;
    scales: Record<string, UnitScale>;
  }
  interface PageParameter {
    name: string;
    doc: string;
    unit: string;
    choices: string[];
    default: string | null;
    min: string | null;
    max: string | null;
    swept: boolean;
    factor: number;
    offset: number;
  }
  interface PagePeak {
    channel: string;
    unit: string;
    display: string;
    lowest: number | null;
    highest: number | null;
    low: number | null;
    high: number | null;
    limit_by: string;
    inside: boolean;
    factor: number;
    offset: number;
  }
  interface PagePose {
    body: string;
    stream: number;
    x: number;
    y: number;
    heading: number | null;
    watched: boolean;
  }
  interface PageProcedure {
    procedure: ProcedureFile;
    title: string;
    doc: string;
    parameters: PageParameter[];
    on_client_loss: "continue" | "finish_trial" | "stop";
  }
  interface PagePrompt {
    id: number;
    name: string;
    text: string;
    kind: "confirm" | "number" | "choice" | "text";
    unit: string;
    low: number | null;
    high: number | null;
    choices: string[];
    answer: number | string | boolean | null;
    objection: string;
    factor: number;
    offset: number;
  }
  interface PageRun {
    line: RunLine;
    parameters: Record<string, JsonValue>;
    last_trial: RecordedTrial | null;
  }
  interface PageStatus {
    v: 1;
    rig: string;
    title: string;
    t_ns: number;
    rows_ns: number;
    seq: number;
    daemon: Daemon;
    state: "idle" | "preflight" | "blocked" | "armed" | "running" | "pausing" | "held" | "paused" | "stopping" | "finishing" | "aborting" | "faulted" | "estopped" | "done";
    procedure: string | null;
    run: string | null;
    step: string | null;
    can_hold: boolean;
    trial: PageTrial | null;
    trials_done: number;
    trials_total: number;
    run_s: number;
    left_s: number | null;
    pause_in_s: number | null;
    waits: string;
    ending: string;
    coming_to_rest: boolean;
    prompt: PagePrompt | null;
    lease: LeaseView;
    trips: TripView[];
    interrupted: Interrupted[];
    last: LastRun | null;
    refused: RefusedCounts;
    notices: OperatorNotice[];
    certificates: CertificateView[];
  }
  interface PageStream {
    number: number;
    name: string;
    channels: PageChannel[];
    rate_hz: number;
  }
  interface PageTrial {
    number: number;
    repeat: number;
    parameters: Record<string, number | string | boolean>;
    units: Record<string, string>;
    label: string;
    scales: Record<string, UnitScale>;
  }
  interface PieceView {
    size: number;
    sha256: string;
    offset: number;
    data: string;
  }
  interface ProblemView {
    message: string;
    hint: string | null;
    line: number | null;
    column: number | null;
  }
  interface ProcedureFile {
    name: string;
    text: string;
    sha256: string;
  }
  interface ProcedureLine {
    name: string;
    title: string;
    sha256: string | null;
    problem: string | null;
  }
  interface ProcedureName {
    name: string;
  }
  interface Procedures {
    procedures: ProcedureLine[];
  }
  interface Receiver {
    to: string;
    user?: string;
  }
  interface RecordedTrial {
    number: number;
    parameters: Record<string, number | string | boolean>;
    units: Record<string, string>;
    scales: Record<string, UnitScale>;
  }
  interface RefusedCounts {
    malformed: number;
    oversized: number;
    replayed: number;
    forbidden: number;
    too_many: number;
  }
  interface RenewedCalibration {
    file: string;
    values: RenewedValue[];
    operator: string;
    valid_until: string;
    remarks: string[];
    written: boolean;
  }
  interface RenewedValue {
    name: string;
    unit: string;
    new: string;
    old: string;
    deviation: number | null;
  }
  interface Reported {
    run: string;
    size: number;
  }
  interface RequestError {
    code: string;
    message: string;
    hint: string | null;
  }
  interface ResumeRun {
    run: string;
    on_client_loss?: "continue" | "finish_trial" | "stop" | null;
  }
  interface RigEvent {
    v: 1;
    seq: number;
    t_ns: number;
    kind: string;
    trial: number;
    data: Record<string, JsonValue>;
  }
  interface RigLink {
    alive: boolean;
    silent_s: number | null;
  }
  type Role = "observer" | "operator" | "maintainer";
  interface RunArguments {
    run: string;
  }
  interface RunLine {
    run: string;
    procedure: string;
    state: string;
    started_ns: number;
    duration_s: number | null;
    trials_done: number;
    trials_total: number;
    size: number;
    has_report: boolean;
    has_page: boolean;
    identifies: boolean;
    calibrates: boolean;
    set: string;
    specimen: string;
    condition: string;
    problem: string | null;
  }
  interface RunList {
    runs: RunLine[];
    more: boolean;
  }
  interface Runs {
    limit?: number;
    before?: string | null;
    where?: string;
  }
  interface SessionReply {
    rig: string;
    session: SessionView | null;
  }
  interface SessionView {
    name: string;
    role: "operator" | "observer";
    identity: string;
  }
  interface SetpointView {
    name: string;
    unit: string;
    low: number;
    high: number;
    rate: number | null;
    rest: number;
  }
  interface Since {
    seq?: number;
  }
  interface Sizes {
    request_bytes: number;
    message_bytes: number;
    piece_bytes: number;
    live_hz: number;
    heartbeat_s: number;
    lease_s: number;
    renew_s: number;
  }
  interface StartArguments {
    procedure: ProcedureFile;
    set?: Record<string, string>;
    seed?: number | null;
    answers?: "ask" | "procedure";
    on_client_loss?: "continue" | "finish_trial" | "stop" | null;
    note?: string;
    meta?: Record<string, string>;
    specimen?: string;
  }
  interface Started {
    run: string | null;
  }
  interface StatedView {
    name: string;
    doc: string;
    required: boolean;
    unit: string;
    choices: string[];
  }
  interface StepView {
    block: "prepare" | "trial" | "after" | "finish";
    name: string;
    setpoints: string[];
    ends: string[];
    played: number;
    shortest_s: number;
    longest_s: number;
    timing: "played" | "known" | "at_most";
  }
  interface Stopped {
    acted: boolean;
  }
  interface TripView {
    interlock: string;
    action: "warn" | "end_trial" | "stop" | "abort" | "estop";
    message: string;
    since_ns: number;
    latched: boolean;
    acknowledged: boolean;
  }
  interface UnitScale {
    factor: number;
    offset: number;
  }
  type JsonValue = string | number | boolean | null | JsonValue[] | JsonObject;
  interface JsonObject {
    [name: string]: JsonValue;
  }
  type LiveMessage = LiveDescription | LiveEvent | LiveLatest | LiveLink | LiveSkipped | LiveStatus;
  interface Asks {
    describe: { args: NoArguments; result: PageDescription };
    procedures: { args: NoArguments; result: Procedures };
    procedure: { args: ProcedureName; result: PageProcedure };
    check: { args: Checked; result: CheckReport };
    runs: { args: Runs; result: RunList };
    run: { args: RunArguments; result: PageRun };
    events: { args: Since; result: Events };
    latest: { args: NoArguments; result: LatestValues };
    compare: { args: ComparedRuns; result: PieceView };
  }
  interface Commands {
    lease_take: { args: NoArguments; result: LeaseView };
    lease_release: { args: NoArguments; result: LeaseView };
    lease_request: { args: NoArguments; result: LeaseView };
    lease_give: { args: Receiver; result: LeaseView };
    lease_seize: { args: NoArguments; result: LeaseView };
    start: { args: StartArguments; result: Started };
    resume_run: { args: ResumeRun; result: Started };
    pause: { args: NoArguments; result: Nothing };
    resume: { args: NoArguments; result: Nothing };
    answer: { args: Answered; result: Nothing };
    acknowledge: { args: InterlockName; result: Nothing };
    act: { args: ActArguments; result: ActionReply };
    identify: { args: RunArguments; result: Reported };
    calibrate: { args: CalibrateArguments; result: RenewedCalibration };
    draw: { args: RunArguments; result: Reported };
    dry_run: { args: Checked; result: PageDryRun };
  }
}
